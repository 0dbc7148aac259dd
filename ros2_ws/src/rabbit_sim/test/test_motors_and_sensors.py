"""Motors against their closed forms; encoders and a lab's sensors against the physics of what they sense."""

import numpy as np
import pytest
from rabbit_description.gait import load_gaits
from rabbit_description.state import TICK_SECONDS
from rabbit_sim.actuation import Actuation
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.perturbation import Memory
from rabbit_sim.perturbations.joints import GEAR_STIFFNESS, ROTOR_INERTIA, Gears, JointDamping
from rabbit_sim.perturbations.motors import MotorLag
from rabbit_sim.perturbations.sensors import Laboratory, Noise, mean_specific_force
from rabbit_sim.plant import SUBSTEP_SECONDS, SUBSTEPS, PlantReading, gravity
from rabbit_sim.robot_urdf import perturbed_urdf
from rabbit_sim.simulation import Simulation
from sensing import begun, state_of

U = np.array([10.0, -40.0, 80.0, 150.0])
ENDS = SUBSTEP_SECONDS * np.arange(1, SUBSTEPS + 1)[:, None]


def motors(**changes):
    return Actuation(SimulationParameters(**changes))


def given(motor):
    """What motors that lag give at this instant, (4,), N m."""
    return motor.states[MotorLag][0, 0]


@pytest.mark.parametrize("lag", [0.001, 0.004, 0.05])
def test_lag_is_the_first_order_step_response(lag):
    """tau(t) = u (1 - exp(-t/T)), also from tick to tick; a substep's mean has its integral."""
    motor = motors(motor_lag=lag)
    means = motor.advance(U)
    response = U * (1 - np.exp(-ENDS / lag))
    assert given(motor) == pytest.approx(response[-1], rel=1e-12)
    area = U * (ENDS - lag * (1 - np.exp(-ENDS / lag)))
    assert SUBSTEP_SECONDS * np.cumsum(means, axis=0) == pytest.approx(area, rel=1e-9)
    motor.advance(U)
    assert given(motor) == pytest.approx(U * (1 - np.exp(-2 * TICK_SECONDS / lag)), rel=1e-12)
    motor.advance(np.zeros(4))
    left = U * (1 - np.exp(-2 * TICK_SECONDS / lag)) * np.exp(-TICK_SECONDS / lag)
    assert given(motor) == pytest.approx(left, rel=1e-9)


def test_loss_takes_its_share_of_the_saturated_torque():
    torque = motors(motor_loss=0.15, torque_limit=100).advance(2 * U)
    assert torque[0] == pytest.approx(0.85 * np.array([20.0, -80.0, 100.0, 100.0]), rel=1e-12)


@pytest.mark.parametrize("delay_ms", [1, 4, 10, 23])
def test_delay_shifts_the_command_by_whole_milliseconds(delay_ms):
    motor = motors(torque_delay=delay_ms * 1e-3)
    commands = [U, -U, 3.0 * np.ones(4), np.zeros(4)]
    given = np.vstack([motor.advance(command) for command in commands])
    asked = np.repeat(commands, SUBSTEPS, axis=0)
    assert not given[:delay_ms].any()
    assert given[delay_ms:] == pytest.approx(asked[:-delay_ms], abs=0)


def test_damping_torque_of_a_knee_is_its_shins_inertia():
    """M_jj of a knee is the shin's inertia about it, in any posture; twice that at twice the mass."""
    shin = 0.20 + 3.2 * 0.24**2
    q, dq = np.array([0.1, 0.7, 0.2, -0.5, 0.6, -0.2, 0.9]), np.array([1, 0, 2, 3, -4, 5, 6.0])
    torque = JointDamping(joint_damping=1.5).joint_torque(perturbed_urdf(SimulationParameters(mass_scale=2)))(q, dq)
    assert torque[[1, 3]] == pytest.approx(-1.5 * 2 * shin * dq[[4, 6]], rel=1e-9)


def reading():
    rng = np.random.default_rng(0)
    return PlantReading(rng.normal(size=7), rng.normal(size=7), rng.normal(size=(2, 2)), np.zeros((2, 2)), None, ())


def measured(count, **changes):
    measure = begun(Noise, SimulationParameters(**changes), 1)
    true = [state_of(truth.q, truth.dq, truth.foot_force) for truth in (reading() for _ in range(count))]
    found = [measure(state, reading()) for state in true]
    return [np.array([getattr(state, name) for state in found]) for name in ("q", "dq", "foot_force")]


def test_encoders_give_multiples_of_their_resolution():
    (q,), _, _ = measured(1, encoder_resolution=0.01)
    assert q[2:] / 0.01 == pytest.approx(np.round(q[2:] / 0.01), abs=1e-9)
    assert np.abs(q - reading().q).max() <= 0.005 + 1e-12
    assert (q[:2] == reading().q[:2]).all()


def test_noise_has_the_asked_spread_and_no_bias():
    _, dq, force = measured(4000, velocity_noise=0.3, force_noise=7.0)
    for error, std in ((dq - reading().dq, 0.3), (force - reading().foot_force, 7.0)):
        noisy = error.reshape(4000, -1)[:, -4:]
        assert noisy.std(axis=0) == pytest.approx(std, rel=0.06)
        assert noisy.mean(axis=0) == pytest.approx(0, abs=0.08 * std)
    assert (dq[:, :2] == reading().dq[:2]).all()


def test_each_motor_has_its_gain_and_the_torque_its_rate():
    """A step to 100 N m at 5,000 N m/s takes 20 ms; then each motor gives its share."""
    gains = {"left_hip_gain": 0.8, "left_knee_gain": 0.9, "right_hip_gain": 1.1}
    drives = Actuation(SimulationParameters(torque_rate=5000.0, **gains))
    torques = np.vstack([drives.advance(np.full(4, 100.0)) for _ in range(3)])
    ramp = np.minimum(5.0 * np.arange(1, 31), 100.0)
    np.testing.assert_allclose(torques, ramp[:, None] * [0.8, 0.9, 1.1, 1.0])


def rotors_on(joint_inertia, gears, torque, seconds):
    """Torque on joints free to turn, from rest: positions and rates of rotors and joints over time, (n, 4)."""
    memory = Memory(joints=np.zeros(4), rates=np.zeros(4))
    gears.begin(memory)
    angle, rate, rows = np.zeros(4), np.zeros(4), []
    for _ in range(round(seconds / SUBSTEP_SECONDS)):
        passed = gears.transmitted(memory, np.full(4, torque), angle, rate)
        rate = rate + SUBSTEP_SECONDS * passed / joint_inertia
        angle = angle + SUBSTEP_SECONDS * rate
        rows.append((memory.joints[0], memory.rates[0], angle[0], rate[0]))
    return np.array(rows)


@pytest.mark.parametrize(("backlash", "stiffness"), [(0.0, 2000.0), (0.5, 0.0)])
def test_gears_take_no_impulse_and_end_with_rotor_and_joint_together(backlash, stiffness):
    """J w_rotor + I w_joint = torque t at all times; the spring's twist settles at the share that the joint needs."""
    inertia, torque = 0.4, 3.0
    ways = rotors_on(inertia, Gears(backlash=backlash, gear_stiffness=stiffness), torque, 2.0)
    t = SUBSTEP_SECONDS * np.arange(1, len(ways) + 1)
    np.testing.assert_allclose(ROTOR_INERTIA * ways[:, 1] + inertia * ways[:, 3], torque * t, rtol=1e-9)
    twist = inertia / (inertia + ROTOR_INERTIA) * torque / (stiffness or GEAR_STIFFNESS) + np.deg2rad(backlash) / 2
    assert ways[-200:, 0].mean() - ways[-200:, 2].mean() == pytest.approx(twist, rel=0.02)


G = 9.81
PERFECT = dict.fromkeys(
    ("encoder_offset", "gyro_noise", "gyro_bias", "accelerometer_noise", "accelerometer_bias", "attitude_error"), 0.0
)


def path(pitch=0.0, acceleration=(0.0, 0.0), samples=SUBSTEPS + 1):
    states = np.zeros((samples, 14))
    states[:, 2] = pitch
    states[:, 7:9] = np.outer(SUBSTEP_SECONDS * np.arange(samples), acceleration)
    return states


@pytest.mark.parametrize(("pitch", "slope"), [(-0.7, 0.0), (0.0, 0.0), (0.3, 0.0), (0.0, 10.0)])
def test_an_accelerometer_at_rest_feels_the_ground_push(pitch, slope):
    """g upward: the torso's forward axis is (cos, -sin) of its lean, its up axis (sin, cos).

    Upright on ground that rises by 10 degrees the torso leans back by 10 degrees.
    """
    lean = pitch - np.deg2rad(slope)
    assert mean_specific_force(path(pitch), gravity(slope)) == pytest.approx([-G * np.sin(lean), G * np.cos(lean)])


def test_an_accelerometer_feels_nothing_in_free_fall_and_an_impact_within_a_tick_in_the_mean():
    """The mean over a tick, times the tick, is the change of velocity less gravity's."""
    assert mean_specific_force(path(0.4, (0.0, -G)), (0, -G)) == pytest.approx([0, 0], abs=1e-9)
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


def test_a_rate_is_that_of_a_millisecond_ago():
    """The slope of a parabola over an interval is its slope in the middle."""
    exact = SimulationParameters(sensors="lab", encoder_resolution=1e-9, **PERFECT)
    measure = begun(Laboratory, exact)
    for number, reading in enumerate(readings(40.0), start=1):
        exactly = state_of(reading.q.copy(), reading.dq.copy(), reading.foot_force.copy())
        rates = measure(exactly, reading).sensors.joint_rates
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
