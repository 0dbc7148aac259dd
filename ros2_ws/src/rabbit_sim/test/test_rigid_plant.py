"""The pinned model and the rigid plant against motion, energy, momentum and impact; what holds for any robot."""

import numpy as np
import pinocchio
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pinned_motion import accelerations
from rabbit_description.gait import load_gait
from rabbit_description.state import TICK_SECONDS, Leg
from rabbit_sim.actuation import Actuation
from rabbit_sim.initial_state import initial_state
from rabbit_sim.kinematics import LegShape, RabbitFeet
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.plant import FOOT_RADIUS
from rabbit_sim.rigid_plant import RigidPlant
from rabbit_sim.robot_urdf import leg_shape, perturbed_urdf, true_mass
from rabbit_sim.stones import draw_course
from rabbit_sim.terrain import Terrain
from true_robot import Truth, random_state

PERTURBED = {"mass_scale": 1.7, "payload": 11.0, "payload_height": 0.4, "link_bend": 0.06, "joint_damping": 2.5}
TORQUE = np.array([12.0, 25.0, -20.0, 8.0])
PRESSING = np.array([-10.0, -25.0, 10.0, -10.0])  # keeps the left foot on the ground


@pytest.mark.parametrize("changes", [{}, PERTURBED])
@pytest.mark.parametrize("leg", Leg)
@pytest.mark.parametrize("seed", range(3))
def test_pinned_dynamics_obey_the_equation_of_motion_and_hold_the_foot(changes, leg, seed):
    robot = Truth(**changes)
    q, dq = random_state(seed)
    ddq, force = accelerations(robot.pinned(), q, dq, TORQUE, leg)
    jacobian, h = robot.jacobian(q, leg), 1e-6
    drift = (robot.jacobian(q + h * dq, leg) - robot.jacobian(q - h * dq, leg)) / (2 * h) @ dq
    assert jacobian @ ddq + drift == pytest.approx([0, 0], abs=1e-6)
    pushed = robot.free_acceleration(q, dq, TORQUE) + np.linalg.solve(robot.mass_matrix(q), jacobian.T @ force)
    assert ddq == pytest.approx(pushed, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("changes", [{}, PERTURBED])
@pytest.mark.parametrize("leg", Leg)
@pytest.mark.parametrize("seed", range(5))
def test_impact_identities(changes, leg, seed):
    """New stance foot at rest, energy not grown, momentum from the impulse alone, none about the contact."""
    robot = Truth(**changes)
    q, dq = random_state(seed)
    after, impulse = robot.pinned().impact(q, dq, leg)
    assert robot.jacobian(q, leg) @ after == pytest.approx([0, 0], abs=1e-12)
    assert robot.energy(q, after) <= robot.energy(q, dq)
    assert robot.momentum(q, after) - robot.momentum(q, dq) == pytest.approx(impulse, rel=1e-9, abs=1e-9)
    contact = RabbitFeet(leg_shape(robot.parameters)).positions(q)[leg]
    before = robot.angular_momentum(q, dq, contact)
    assert robot.angular_momentum(q, after, contact) == pytest.approx(before, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("changes", [{}, {**PERTURBED, "joint_damping": 0.0}])
def test_rigid_keeps_energy_and_its_foot_without_torque(changes):
    robot = Truth(plant="rigid", **changes)
    q, dq = robot.start()
    plant = RigidPlant(robot.parameters)
    plant.reset(q, dq, Leg.LEFT)
    for _ in range(8):
        plant.advance(np.zeros(4))
    reading = plant.observe()
    assert reading.contact.tolist() == [True, False]
    assert robot.energy(reading.q, reading.dq) == pytest.approx(robot.energy(q, dq), rel=1e-9)
    assert reading.foot_position[Leg.LEFT] == pytest.approx([0, 0], abs=1e-10)


@pytest.mark.parametrize("changes", [{}, PERTURBED])
def test_rigid_locates_the_impact_and_pins_the_other_foot(changes):
    robot = Truth(plant="rigid", **changes)
    plant, after = RigidPlant(robot.parameters), None
    plant.reset(*robot.start(), Leg.LEFT)
    while after is None or not after.touches:
        before = plant.observe()
        plant.advance(PRESSING)
        after = plant.observe()
    (touch,) = after.touches
    assert touch.leg is Leg.RIGHT
    assert after.foot_position[Leg.RIGHT] == pytest.approx([touch.x, 0], abs=1e-9)
    assert touch.other_x == pytest.approx(0, abs=1e-9)
    assert after.contact.tolist() == [False, True]
    assert robot.jacobian(after.q, Leg.RIGHT) @ after.dq == pytest.approx([0, 0], abs=1e-9)
    gained = robot.momentum(after.q, after.dq) - robot.momentum(before.q, before.dq)
    given = after.foot_force.sum(axis=0) * TICK_SECONDS - [0, robot.mass * 9.81 * TICK_SECONDS]
    assert given == pytest.approx(gained, rel=1e-7)


@pytest.mark.parametrize("slope", [4.0, -7.0])
def test_a_slope_is_a_turned_world(slope):
    """In the ground's frame and in the level one the robot does the same; the pinned foot knows no ground."""
    robot, angle = Truth(slope=slope, plant="rigid", motor_lag=0.004), np.deg2rad(slope)
    uphill = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])  # from the ground's frame
    q, dq = robot.start()
    tilted, level = RigidPlant(robot.parameters), RigidPlant(Truth(plant="rigid", motor_lag=0.004).parameters)
    tilted.reset(q, dq, Leg.LEFT)
    level.reset(np.r_[uphill @ q[:2], q[2] - angle, q[3:]], np.r_[uphill @ dq[:2], dq[2:]], Leg.LEFT)
    for _ in range(5):
        tilted.advance(PRESSING)
        level.advance(PRESSING)
    seen, turned = tilted.observe(), level.observe()
    np.testing.assert_allclose(turned.q, np.r_[uphill @ seen.q[:2], seen.q[2] - angle, seen.q[3:]], atol=1e-9)
    np.testing.assert_allclose(turned.dq, np.r_[uphill @ seen.dq[:2], seen.dq[2:]], atol=1e-9)
    np.testing.assert_allclose(turned.foot_force, seen.foot_force @ uphill.T, atol=1e-6)


def test_loads_weigh_where_they_are():
    """Mass and CoM of the whole robot, and the inertia about it, by Steiner's theorem for each part."""
    plain = Truth(mass_scale=1.5)
    loaded = Truth(mass_scale=1.5, payload=8.0, payload_ahead=0.1, payload_height=0.3, left_leg_scale=1.3)
    upright = np.zeros(7)
    legs = 0.3 * 1.5 * np.array([6.8, 3.2])  # added to the left thigh and shin
    mass, moment = 48.0 + 8.0 + legs.sum(), 8.0 * np.array([0.1, 0.3]) + np.array([0.0, legs @ [-0.11, -0.64]])
    assert true_mass(loaded.parameters) == pytest.approx(mass)
    assert loaded.mass_matrix(upright)[0, 0] == pytest.approx(mass)
    added = loaded.mass_matrix(upright) - plain.mass_matrix(upright)
    assert added[:2, 2] == pytest.approx([moment[1], -moment[0]])  # of a turn about +y
    about_hip = 8.0 * (0.1**2 + 0.3**2) + legs @ [0.11**2 + 0.47 / 6.8, 0.64**2 + 0.20 / 3.2]
    assert added[2, 2] == pytest.approx(about_hip)


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


@settings(max_examples=100, deadline=None)
@given(robots, st.just(FOOT_RADIUS) | numbers(FOOT_RADIUS, 0.2), postures, rates, legs)
def test_a_sole_is_where_its_lowest_point_is(p, radius, q, dq, leg):
    """And it moves as a part of the shin, by pinocchio; the smallest is the URDF's foot."""
    p = p.model_copy(update={"sole_radius": radius})
    model = pinocchio.buildModelFromXML(perturbed_urdf(p))
    data, foot = model.createData(), model.getFrameId(("left_foot", "right_foot")[leg])
    roll = p.sole_radius - FOOT_RADIUS
    pinocchio.forwardKinematics(model, data, q, dq, np.zeros(7))
    pinocchio.updateFramePlacements(model, data)
    axes = pinocchio.LOCAL_WORLD_ALIGNED
    frame = data.oMf[foot]
    place = frame.act(np.array([0.0, 0.0, roll]))[[0, 2]] - (0.0, roll)
    motion = pinocchio.getFrameVelocity(model, data, foot, axes)
    ahead, up = place - frame.translation[[0, 2]]
    velocity = motion.linear[[0, 2]] + motion.angular[1] * np.array([up, -ahead])
    np.testing.assert_allclose(RabbitFeet(leg_shape(p)).positions(q)[leg], place, atol=1e-12)
    np.testing.assert_allclose(RabbitFeet(leg_shape(p)).jacobian(q, leg) @ dq, velocity, atol=1e-11)


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
