"""What must hold for any parameters, states and commands."""

import numpy as np
import pinocchio
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rabbit_description.gait import load_gait
from rabbit_description.state import Leg
from rabbit_sim.actuation import Actuation
from rabbit_sim.initial_state import initial_state
from rabbit_sim.kinematics import LegShape, RabbitFeet
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.plant import FOOT_RADIUS
from rabbit_sim.robot_urdf import leg_shape, perturbed_urdf
from rabbit_sim.stones import draw_course
from rabbit_sim.terrain import Terrain

GAIT = load_gait("authors_035")


def numbers(low, high):
    return st.floats(low, high, allow_nan=False, allow_subnormal=False)


robots = st.builds(
    SimulationParameters,
    mass_scale=numbers(0.2, 5),
    payload=numbers(0, 80),
    payload_height=numbers(-0.2, 0.6),
    link_bend=numbers(-0.2, 0.2),
    leg_stretch=numbers(0.9, 1.1),
)
postures = arrays(float, 7, elements=numbers(-1.5, 1.5))
rates = arrays(float, 7, elements=numbers(-10, 10))
commands = arrays(float, (6, 4), elements=numbers(-1000, 1000))
legs = st.sampled_from(Leg)


def model_of(parameters):
    model = pinocchio.buildModelFromXML(perturbed_urdf(parameters))
    return model, model.createData(), [model.getFrameId(name) for name in ("left_foot", "right_foot")]


@settings(max_examples=50, deadline=None)
@given(robots, postures, rates, legs)
def test_own_kinematics_are_those_of_the_urdf(p, q, dq, leg):
    check_kinematics(p, q, dq, leg)


@settings(max_examples=50, deadline=None)
@given(robots, numbers(FOOT_RADIUS, 0.2), postures, rates, legs)
def test_a_round_sole_is_where_its_lowest_point_is(p, radius, q, dq, leg):
    check_kinematics(p.model_copy(update={"sole_radius": radius}), q, dq, leg)


def check_kinematics(p, q, dq, leg):
    """The lowest point of the sole, and how it moves as a part of the shin, against pinocchio."""
    model, data, frames = model_of(p)
    roll = p.sole_radius - FOOT_RADIUS
    pinocchio.forwardKinematics(model, data, q, dq, np.zeros(7))
    pinocchio.updateFramePlacements(model, data)
    axes = pinocchio.LOCAL_WORLD_ALIGNED
    frame = data.oMf[frames[leg]]
    place = frame.act(np.array([0.0, 0.0, roll]))[[0, 2]] - (0.0, roll)
    motion = pinocchio.getFrameVelocity(model, data, frames[leg], axes)
    ahead, up = place - frame.translation[[0, 2]]
    velocity = motion.linear[[0, 2]] + motion.angular[1] * np.array([up, -ahead])
    np.testing.assert_allclose(RabbitFeet(leg_shape(p)).positions(q)[leg], place, atol=1e-12)
    np.testing.assert_allclose(RabbitFeet(leg_shape(p)).jacobian(q, leg) @ dq, velocity, atol=1e-11)


@settings(max_examples=50, deadline=None)
@given(robots, rates)
def test_a_payload_is_a_point_mass(p, dq):
    """Its kinetic energy is half its mass times its own squared speed, at any pitch rate."""
    q = np.zeros(7)
    dq = np.r_[dq[:3], np.zeros(4)]
    energies = []
    for payload in (p.payload, 0.0):
        model, data, _ = model_of(p.model_copy(update={"payload": payload}))
        energies.append(pinocchio.computeKineticEnergy(model, data, q, dq))
    speed_squared = (dq[0] + dq[2] * p.payload_height) ** 2 + dq[1] ** 2
    assert np.isclose(energies[0] - energies[1], p.payload * speed_squared / 2, rtol=1e-9, atol=1e-7)


@settings(max_examples=50, deadline=None)
@given(commands, numbers(0, 0.05), numbers(0, 0.9), st.integers(0, 30), numbers(1, 300))
def test_no_motor_gives_more_than_its_limit_and_loss_allow(asked, lag, loss, delay_ms, limit):
    motor = Actuation(
        SimulationParameters(motor_lag=lag, motor_loss=loss, torque_delay=delay_ms * 0.001, torque_limit=limit)
    )
    for command in asked:
        given_torque = motor.advance(command)
        assert given_torque.shape == (10, 4)
        assert np.abs(given_torque).max() <= (1 - loss) * limit * (1 + 1e-9)


@settings(max_examples=50, deadline=None)
@given(st.integers(0, 2**32), st.lists(numbers(-0.02, 0.02), min_size=20, max_size=20))
def test_absolute_stones_do_not_depend_on_where_the_feet_land(seed, errors):
    p = SimulationParameters(stone_placement="absolute", stones=20)
    course = draw_course(p, np.random.default_rng(seed))
    exact, sloppy = Terrain(p, course), Terrain(p, course)
    for index, error in enumerate(errors, start=1):
        exact.place_next(index, 0.0)
        seen = sloppy.place_next(index, error)
        near, far, _ = sloppy.placed[-1]
        np.testing.assert_allclose((seen.l_min + error, seen.l_max + error), (near, far), atol=1e-12)
    np.testing.assert_allclose(exact.placed, sloppy.placed, atol=1e-12)


@settings(max_examples=100, deadline=None)
@given(st.integers(0, 2**32), numbers(0, 3), numbers(-0.1, 0.1))
def test_the_first_state_stands_whatever_the_noise(seed, spread, bend):
    p = SimulationParameters(x0_spread=spread, link_bend=bend)
    q, dq = initial_state(p, GAIT, np.random.default_rng(seed))
    feet = RabbitFeet(LegShape.of(bend)).positions(q)
    np.testing.assert_allclose(feet[Leg.LEFT], 0, atol=1e-12)
    np.testing.assert_allclose(RabbitFeet(LegShape.of(bend)).jacobian(q, Leg.LEFT) @ dq, 0, atol=1e-11)
    assert feet[Leg.RIGHT, 1] >= -1e-12
