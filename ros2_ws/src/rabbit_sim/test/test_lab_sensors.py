"""A lab's sensors against the physics of what they sense."""

import numpy as np
import pytest
from rabbit_description.gait import load_gaits
from rabbit_description.state import TICK_SECONDS
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.perturbations.sensors import Laboratory, mean_specific_force
from rabbit_sim.plant import SUBSTEP_SECONDS, SUBSTEPS, PlantReading, gravity
from rabbit_sim.simulation import Simulation
from sensing import begun, state_of

G = 9.81
PERFECT = dict.fromkeys(
    ("encoder_offset", "gyro_noise", "gyro_bias", "accelerometer_noise", "accelerometer_bias", "attitude_error"), 0.0
)


def path(pitch=0.0, acceleration=(0.0, 0.0), samples=SUBSTEPS + 1):
    states = np.zeros((samples, 14))
    states[:, 2] = pitch
    states[:, 7:9] = np.outer(SUBSTEP_SECONDS * np.arange(samples), acceleration)
    return states


@pytest.mark.parametrize("pitch", [-0.7, 0.0, 0.3])
def test_an_accelerometer_at_rest_feels_the_ground_push(pitch):
    """g upward in the world: the torso's forward axis is (cos, -sin), its up axis (sin, cos) of the pitch."""
    assert mean_specific_force(path(pitch), (0, -G)) == pytest.approx([-G * np.sin(pitch), G * np.cos(pitch)])


def test_on_a_slope_it_feels_the_vertical():
    """Upright on ground that rises by 10 degrees the torso leans back by 10 degrees."""
    leaning = np.deg2rad(-10.0)
    assert mean_specific_force(path(), gravity(10.0)) == pytest.approx([-G * np.sin(leaning), G * np.cos(leaning)])


def test_an_accelerometer_in_free_fall_feels_nothing():
    assert mean_specific_force(path(0.4, (0.0, -G)), (0, -G)) == pytest.approx([0, 0], abs=1e-9)


def test_an_impact_within_a_tick_is_in_the_mean():
    """The mean over a tick, times the tick, is the change of velocity less gravity's."""
    states = path()
    states[5:, 7] = -0.3
    assert mean_specific_force(states, (0, -G))[0] * TICK_SECONDS == pytest.approx(-0.3)


def readings(acceleration):
    """Two ticks in which each joint turns with a constant acceleration from rest."""
    time = SUBSTEP_SECONDS * np.arange(1, 2 * SUBSTEPS + 1)
    states = np.zeros((2 * SUBSTEPS, 14))
    states[:, 3:7], states[:, 10:] = (acceleration * time**2 / 2)[:, None], (acceleration * time)[:, None]
    for rows in (states[:SUBSTEPS], states[SUBSTEPS:]):
        still = np.zeros((2, 2)), np.zeros((2, 2)), np.ones(2, bool), ()
        yield PlantReading(rows[-1, :7], rows[-1, 7:], *still, rows)


def exactly(reading):
    return state_of(reading.q.copy(), reading.dq.copy(), reading.foot_force.copy())


def test_a_rate_is_that_of_a_millisecond_ago():
    """The slope of a parabola over an interval is its slope in the middle."""
    exact = SimulationParameters(sensors="lab", encoder_resolution=1e-9, **PERFECT)
    measure = begun(Laboratory, exact)
    for number, reading in enumerate(readings(40.0), start=1):
        rates = measure(exactly(reading), reading).sensors.joint_rates
        assert rates == pytest.approx(40.0 * (number * TICK_SECONDS - SUBSTEP_SECONDS), abs=1e-5)


@pytest.mark.parametrize("plant", ["pybullet", "mujoco", "rigid"])
def test_perfect_sensors_and_the_truth_agree_on_every_plant(plant):
    """Attitude and gyro are pitch and its rate; the velocity is the integral of the accelerometer, impacts included."""
    parameters = SimulationParameters(sensors="lab", plant=plant, **PERFECT)
    simulation = Simulation(parameters, load_gaits("stones_0350_080"))
    state = simulation.reset(3)
    assert np.isnan(state.q).all()
    assert np.isnan(state.sensors.specific_force).all()
    before = simulation.reading
    while state.running and state.tick < 40:
        state = simulation.step(np.zeros(4))
        true, sensed = simulation.reading, state.sensors
        assert (sensed.attitude, sensed.pitch_rate) == pytest.approx((true.q[2], true.dq[2]))
        pitch = (before.q[2] + true.q[2]) / 2
        c, s = np.cos(pitch), np.sin(pitch)
        gained = np.array([[c, s], [-s, c]]) @ sensed.specific_force - (0, G)
        speeds = np.vstack([before.dq[:2], true.path[:, 7:9]])
        impulse = np.linalg.norm(np.diff(speeds, axis=0) + (0, G * SUBSTEP_SECONDS), axis=1).sum()
        turned = np.abs(true.path[:, 2] - pitch).max()  # by which the mean attitude may be off
        allowed = 1e-9 + turned * impulse
        assert true.dq[:2] - before.dq[:2] == pytest.approx(gained * TICK_SECONDS, abs=allowed)
        before = true
    simulation.close()


def test_constant_errors_are_constant_and_noise_has_its_spread():
    spread = {"encoder_offset": 0.01, "gyro_noise": 0.02, "gyro_bias": 0.0, "accelerometer_noise": 0.5}
    parameters = SimulationParameters(sensors="lab", **{**PERFECT, **spread})
    rate, force, offsets = [], [], []
    for seed in range(400):
        measure = begun(Laboratory, parameters, seed)
        measured = [measure(exactly(reading), reading).sensors for reading in readings(0.0)]
        offsets.append([each.joint_angles for each in measured])
        rate.append(measured[0].pitch_rate)
        force.append(measured[1].specific_force - (0, G))
    first, second = np.array(offsets).transpose(1, 0, 2)
    assert (first == second).all()
    for values, std in ((first, 0.01), (np.array(rate), 0.02), (np.array(force), 0.5)):
        assert abs(values.mean()) < 4 * std / np.sqrt(values.size)
        assert values.std() == pytest.approx(std, rel=0.15)
