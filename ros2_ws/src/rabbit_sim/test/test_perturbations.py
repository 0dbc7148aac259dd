"""Perturbations of structure and wind against what their formulas say."""

from math import exp, pi, radians, sqrt, tan
from typing import Any

import numpy as np
import pytest
from rabbit_description.gait import load_gait
from rabbit_description.state import TICK_SECONDS, TORQUE_LIMIT, Leg, RobotState
from rabbit_sim.actuation import Actuation
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.perturbation import Memory
from rabbit_sim.perturbations.encoders import EncoderDrift, EncoderGain, StuckEncoders
from rabbit_sim.perturbations.ground import TippingStones
from rabbit_sim.perturbations.joints import (
    DAHL_STIFFNESS,
    ECCENTRIC_PERIODS,
    Cogging,
    CoupledJoints,
    EccentricGears,
    FadingMotors,
    HotMotors,
    Hysteresis,
    LostCommands,
    SharedSupply,
    StickSlip,
)
from rabbit_sim.perturbations.sensors import SensorDropout, SensorJitter
from rabbit_sim.perturbations.wind import Wind
from rabbit_sim.plant import SUBSTEP_SECONDS, SUBSTEPS, PlantReading, Touch
from rabbit_sim.simulation import Simulation
from sensing import begun, state_of
from true_robot import Truth, random_state


def measured(value: float) -> RobotState:
    return state_of(np.full(7, value), np.full(7, value), np.zeros((2, 2)))


def reading(q: float = 0.0, path: np.ndarray | None = None) -> PlantReading:
    state, feet = np.full(7, q), np.zeros((2, 2))
    return PlantReading(state, state, feet, feet, np.zeros(2, dtype=bool), (), path)


def test_second_order_motors_overshoot_as_their_damping_says() -> None:
    """A step's largest value is 1 + exp(-pi z / sqrt(1 - z^2)), after half a damped period."""
    frequency, z = 10.0, 0.3
    motors = Actuation(SimulationParameters(motor_frequency=frequency, motor_damping=z))
    torque = np.concatenate([motors.advance(np.full(4, 100.0)) for _ in range(60)])[:, 0]
    assert torque.max() == pytest.approx(100 * (1 + exp(-pi * z / sqrt(1 - z**2))), rel=1e-3)
    peak = (torque.argmax() + 0.5) * SUBSTEP_SECONDS
    assert peak == pytest.approx(1 / (2 * frequency * sqrt(1 - z**2)), abs=1.5e-3)
    assert torque[-1] == pytest.approx(100, rel=1e-3)


def test_a_dead_zone_lacks_its_torque_and_motors_with_steps_give_the_nearest() -> None:
    motors = Actuation(*(SimulationParameters(**plant) for plant in ({"dead_zone": 5.0}, {"torque_step": 30.0}, {})))
    asked = [14.0, 16.0, -44.0, -46.0]
    dead, steps, exact = motors.advance(np.array([[3.0, -5.0, 8.0, -20.0], asked, asked]))
    assert dead[0].tolist() == [0.0, 0.0, 3.0, -15.0]
    assert steps[0].tolist() == [0.0, 30.0, -30.0, -60.0]
    assert exact[0].tolist() == asked


def test_dahl_friction_saturates_and_takes_energy_in_each_cycle() -> None:
    """Far in one direction it is F; at first it grows with the stiffness; a closed path of the joint costs work."""
    friction, none, memory = Hysteresis(hysteresis=10.0), np.zeros(4), Memory()
    friction.begin(memory)
    rate = np.full(4, 1e-3)
    small = -friction.transmitted(memory, none, none, rate)
    assert small == pytest.approx(DAHL_STIFFNESS * SUBSTEP_SECONDS * rate, rel=1e-3)
    for _ in range(500):
        largest = -friction.transmitted(memory, none, none, np.ones(4))
    assert largest == pytest.approx(np.full(4, 10.0))
    work = 0.0
    for substep in range(1000):
        rate = np.full(4, np.sin(2 * pi * substep / 1000))
        work += float(-friction.transmitted(memory, none, none, rate)[0] * rate[0]) * SUBSTEP_SECONDS
    assert work > 0


def test_a_stone_tips_by_the_distance_from_its_middle() -> None:
    stones = TippingStones(stone_tilt=20.0)
    assert stones.drop(3, -0.02) == stones.drop(1, 0.02) == pytest.approx(0.02 * tan(radians(20)))
    assert stones.drop(1, 0.0) == 0.0


def test_lost_measurements_are_the_last_that_came() -> None:
    measure = begun(SensorDropout, SimulationParameters(sensor_dropout=0.3), 1)
    seen = [measure(measured(float(tick)), reading()).q[0] for tick in range(4000)]
    lost = [now != tick for tick, now in enumerate(seen)]
    assert all(now == seen[tick - 1] for tick, now in enumerate(seen) if lost[tick])
    assert np.mean(lost) == pytest.approx(0.3, abs=0.03)  # four standard deviations


def test_one_encoder_sticks_with_no_rate() -> None:
    measure = begun(StuckEncoders, SimulationParameters(stuck_seconds=0.05), 2)
    stuck = 0
    for tick in range(3000):
        angles, rates = measure(measured(1.0 + tick), reading()).joints
        wrong = np.flatnonzero(rates != 1.0 + tick)
        assert len(wrong) <= 1
        assert not rates[wrong].any()
        assert (angles[wrong] <= 1.0 + tick).all()
        stuck += len(wrong)
    assert stuck / 3000 == pytest.approx(0.05 / 1.05, rel=0.5)


def test_a_drift_is_its_rate_times_the_time() -> None:
    measure = begun(EncoderDrift, SimulationParameters(encoder_drift=0.01), 3)
    for _ in range(101):
        now = measure(measured(0.0), reading())
    assert now.q[3:] == pytest.approx(now.dq[3:] * 1.0)
    assert not now.q[:3].any()
    assert now.dq[3:].all()


def test_late_measurements_are_of_the_past_at_most_so_old() -> None:
    measure = begun(SensorJitter, SimulationParameters(sensor_jitter=0.015), 5)
    ages = []
    for tick in range(2000):
        path = np.arange(10 * tick + 1, 10 * tick + 11)[:, None] * np.ones(14)
        ages.append(10 * tick + 10 - measure(measured(0.0), reading(path=path)).q[0])
    assert {*ages[3:]} == {float(age) for age in range(16)}


def test_late_rates_have_their_noise() -> None:
    """The angles, which have none, say how old a measurement is; its rates are off by the noise."""
    noisy = SimulationParameters(sensor_jitter=0.005, velocity_noise=0.1)
    simulation = Simulation(noisy, load_gait("stones_0350_070"))
    state, trace, off = simulation.reset(1), np.zeros((0, 14)), []
    while state.running and state.tick < 60:
        state = simulation.step(np.zeros(4))
        assert simulation.reading.path is not None
        trace = np.vstack([trace, simulation.reading.path])
        (age,) = np.flatnonzero((trace[:, :7] == state.q).all(axis=1))
        off.append(state.dq - trace[age, 7:])
    simulation.close()
    assert not np.array(off)[:, :2].any()
    assert np.std(np.array(off)[:, 2:]) == pytest.approx(0.1, rel=0.2)


RATES, WANTED = [4.0, -4.0, -2.0, 0.0], [100.0, -50.0, 80.0, 20.0]


@pytest.mark.parametrize(
    ("joints", "rates", "asked", "given"),
    [
        # it brakes with all its torque; at half the no-load speed half the stall torque is left along the motion
        (FadingMotors(no_load_speed=10.0), [5.0, 5.0, 0.0, 12.0], [150.0, -150.0, 150.0, 150.0], [100, -150, 150, 0]),
        (CoupledJoints(joint_coupling=0.25), [0.0] * 4, [40.0, 1.0, -8.0, 2.0], [40, 11, -8, 0]),  # a hip at its knee
        (SharedSupply(supply_power=300.0), RATES, WANTED, [50, -25, 80, 20]),  # they drive with 300 W, brake with all
        (SharedSupply(supply_power=1000.0), RATES, WANTED, WANTED),
    ],
)
def test_what_passes_the_joints_of_the_torque(joints: Any, rates: Any, asked: Any, given: Any) -> None:
    torque = np.array(asked)
    assert joints.transmitted(Memory(), torque, np.zeros(4), np.array(rates)) == pytest.approx(given)
    assert torque.tolist() == asked


@pytest.mark.parametrize(
    ("joints", "asked", "swing"), [(Cogging(cogging=7.0), 0.0, 7.0), (EccentricGears(gear_eccentricity=0.5), 10.0, 5.0)]
)
def test_over_a_turn_the_mean_torque_is_the_one_that_was_asked_for(joints: Any, asked: float, swing: float) -> None:
    """So cogging does no work."""
    angles = np.arange(0, 2 * pi, 1e-3)
    given = [joints.transmitted(Memory(), np.full(4, asked), np.full(4, angle), np.ones(4))[0] for angle in angles]
    assert np.mean(given) == pytest.approx(asked, rel=1e-3, abs=2e-4)
    assert [np.min(given), np.max(given)] == pytest.approx([asked - swing, asked + swing], rel=1e-3)
    if isinstance(joints, EccentricGears):
        assert np.sum(np.diff(np.array(given) > asked)) == 2 * ECCENTRIC_PERIODS


def test_a_joint_breaks_away_with_all_its_friction_and_slides_with_half_of_it() -> None:
    joints, none, memory = StickSlip(stick_slip=20.0), np.zeros(4), Memory()
    joints.begin(memory)
    for rate, friction in ((1e-3, 20.0), (3.0, 10.0), (-3.0, -10.0)):
        for _ in range(round(1.0 / (abs(rate) * SUBSTEP_SECONDS))):  # over a radian
            left = joints.transmitted(memory, none, none, np.full(4, rate))
        assert left == pytest.approx(np.full(4, -friction), rel=1e-3)


def test_a_hot_motor_gives_its_torque_over_one_and_its_heat() -> None:
    """Half the limit heats with a quarter of a second each second."""
    motors, asked, memory = HotMotors(motor_heating=0.5), np.full(4, TORQUE_LIMIT / 2), Memory()
    motors.begin(memory)
    given = [motors.transmitted(memory, asked, asked, asked)[0] for _ in range(2001)]
    assert given[0] == asked[0]
    assert given[-1] == pytest.approx(asked[0] / (1 + 0.5 * 0.25 * 2.0))


def test_a_lost_command_leaves_the_torque_for_a_whole_tick() -> None:
    bus, torque = LostCommands(command_dropout=0.3), np.arange(4.0)
    memory = Memory(rng=np.random.default_rng(2), parameters=SimulationParameters())
    bus.begin(memory)
    asked = np.arange(1, 4000 * SUBSTEPS + 1)
    given = np.array([bus.transmitted(memory, torque + k, torque, torque)[0] for k in asked]).reshape(-1, SUBSTEPS)
    lost = (given != asked.reshape(-1, SUBSTEPS)).any(axis=1)
    assert (given[lost] == given[lost, :1]).all()
    assert (given[1:][lost[1:], 0] == given[:-1][lost[1:], -1]).all()
    assert lost.mean() == pytest.approx(0.3, abs=0.03)  # four standard deviations


def test_zeros_jump_by_as_much_as_they_are_said_to_at_each_touchdown() -> None:
    """After n touchdowns they are off by sqrt(n) times the spread."""
    down = PlantReading(*np.zeros((2, 7)), *np.zeros((2, 2, 2)), np.zeros(2, bool), (Touch(Leg.LEFT, 0, 0, hold=True),))
    off = []
    for seed in range(500):
        measure = begun(EncoderDrift, SimulationParameters(encoder_jump=0.01), seed)
        assert measure(measured(0.0), reading()).q.tolist() == [0.0] * 7
        for _ in range(4):
            measure(measured(0.0), down)
        state = measure(measured(0.0), reading())
        assert not state.dq.any()
        off.append(state.q)
    assert np.std(off, axis=0)[3:] == pytest.approx(np.full(4, 0.02), rel=0.13)  # four standard deviations
    assert not np.any(np.array(off)[:, :3])


def test_each_stone_rubs_as_it_is_drawn() -> None:
    """Uniform from (1 - spread) of the ground's coefficient up to all of it; the same for the same episode."""
    simulation = Simulation(SimulationParameters(plant="mujoco", ground_friction=0.8, friction_spread=0.5), GAIT)
    found = []
    for seed in [*range(300), 7]:
        simulation.reset(seed)
        found.append(simulation.plant.model.geom("left_foot").friction[0])
    assert found[7] == found[-1]
    assert 0.4 <= min(found) < 0.41 < 0.79 < max(found) <= 0.8
    assert np.mean(found) == pytest.approx(0.6, abs=0.03)
    simulation.close()


def test_an_encoder_with_a_gain_measures_the_rate_of_its_own_angle() -> None:
    measure = begun(EncoderGain, SimulationParameters(encoder_gain_spread=0.1), 3)
    first, second = (measure(measured(value), reading()) for value in (1.0, 2.0))
    assert second.q[3:] == pytest.approx(2 * first.q[3:])
    assert first.q[3:] == pytest.approx(first.dq[3:])
    assert len(set(first.q[3:])) == 4
    assert first.q[:3].tolist() == [1.0] * 3


GAIT = load_gait("authors_035")


@pytest.mark.parametrize("plant", ["pybullet", "mujoco"])
@pytest.mark.parametrize("wind", [40.0, -15.0])
def test_wind_gives_a_falling_robot_its_impulse(plant, wind):
    """Momentum is force times time along the ground; nothing else acts there."""
    parameters = SimulationParameters(plant=plant, wind=wind, stop_at_miss=False, fall_height=0, fall_pitch=3.0)
    robot, simulation = Truth(), Simulation(parameters, GAIT)
    simulation.reset(1)
    q, _ = random_state(4)
    simulation.plant.reset(q, np.zeros(7), 0)
    for _ in range(5):
        simulation.step(np.zeros(4))
    after = simulation.reading
    assert robot.momentum(after.q, after.dq)[0] == pytest.approx(wind * 5 * TICK_SECONDS, rel=2e-3)
    simulation.close()


def test_gusts_have_their_spread_and_their_time_constant():
    """Mean, standard deviation and the correlation exp(-t / T) of a Gauss-Markov process from its first tick on."""
    many = np.zeros((800, 60))
    for seed, found in enumerate(many):
        wind = Wind(wind=20.0, gusts=8.0, gust_seconds=0.2)
        memory = Memory(rng=np.random.default_rng(seed), parameters=SimulationParameters())
        wind.begin(memory)
        forces = np.array([wind.force(memory, tick) for tick in range(60)])
        assert forces.shape == (60, SUBSTEPS)
        assert (forces == forces[:, :1]).all()  # each held over its substeps
        found[:] = forces[:, 0]
    np.testing.assert_allclose(many.mean(axis=0), 20.0, atol=5 * 8 / np.sqrt(800))
    np.testing.assert_allclose(many.std(axis=0), 8.0, rtol=0.13)
    for lag in (1, 20, 50):
        correlation = np.corrcoef(many[:, 5], many[:, 5 + lag])[0, 1]
        assert correlation == pytest.approx(np.exp(-lag * TICK_SECONDS / 0.2), abs=0.15)
