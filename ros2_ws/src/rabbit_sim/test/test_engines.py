"""PyBullet and MuJoCo against pinocchio, momentum, Coulomb's law and the pinned model."""

from contextlib import contextmanager

import mujoco
import numpy as np
import pytest
from rabbit_description.gait import load_gait
from rabbit_description.state import TICK_SECONDS, Leg
from rabbit_sim.initial_state import initial_state, project
from rabbit_sim.kinematics import RabbitFeet
from rabbit_sim.mujoco_plant import MujocoPlant
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.perturbations.ground import RUBBER_DAMPING, RUBBER_STIFFNESS
from rabbit_sim.plant import FOOT_RADIUS, GRAVITY, Span
from rabbit_sim.pybullet_plant import PybulletPlant
from rabbit_sim.rigid_plant import RigidPlant
from rabbit_sim.robot_urdf import leg_shape
from true_robot import Truth, random_state

PERTURBED = {"mass_scale": 1.7, "payload": 11.0, "payload_height": 0.4, "link_bend": 0.06, "joint_damping": 2.5}
LOADED = {"payload": 8.0, "payload_ahead": 0.1, "left_leg_scale": 1.3, "swing_payload": 9.0, "slope": 3.0}
SLIDING = {"sliding_payload": 9.0, "payload_height": 0.4}
GROUND = [Span(-5.0, 5.0)]
TORQUE = np.array([12.0, 25.0, -20.0, 8.0])
SETTLING_TICKS = round(5 * RUBBER_DAMPING / RUBBER_STIFFNESS / TICK_SECONDS)
PRESSING = np.array([-10.0, -25.0, 10.0, -10.0])  # keeps the left foot on the ground


@contextmanager
def world(engine, parameters, q, dq, spans=()):
    plant = engine(parameters)
    try:
        plant.reset(q, dq, Leg.LEFT)
        plant.set_stones(spans)
        yield plant
    finally:
        plant.close()


@pytest.fixture(params=[PybulletPlant, MujocoPlant], ids=["pybullet", "mujoco"])
def engine(request):
    return request.param


@pytest.mark.parametrize("radius", [0.03, 0.06])
def test_a_standing_sole_rolls_by_its_radius_times_the_shins_turn(engine, radius):
    parameters = SimulationParameters(sole_radius=radius)
    q, dq = initial_state(parameters, load_gait("authors_035"), np.random.default_rng(1))
    with world(engine, parameters, q, dq, GROUND) as plant:
        for _ in range(SETTLING_TICKS):
            plant.advance(PRESSING)
        before = plant.observe()
        for _ in range(6):
            plant.advance(PRESSING)
            assert plant.observe().contact[Leg.LEFT]
        after = plant.observe()
    shin = [float(reading.q[2:5].sum()) for reading in (before, after)]
    rolled = after.foot_position[Leg.LEFT, 0] - before.foot_position[Leg.LEFT, 0]
    assert abs(shin[1] - shin[0]) > 0.02
    assert rolled == pytest.approx(radius * (shin[1] - shin[0]), rel=0.05)


def standing(robot):
    """A first posture at rest."""
    return project(robot.start()[0], np.zeros(7), RabbitFeet())


def acceleration(plant, dq):
    """Under TORQUE. Bullet's new velocity is v + dt a(q, v): one short step gives `a` up to rounding in v / dt."""
    if isinstance(plant, MujocoPlant):
        plant._data.qfrc_applied[3:7] = plant.at_joints(TORQUE)
        mujoco.mj_forward(plant.model, plant._data)
        return plant._data.qacc[:7].copy()
    dt = 1e-5
    plant._client.setTimeStep(dt)
    plant._apply(plant.at_joints(TORQUE))
    plant._client.stepSimulation()
    return (plant._joint_states()[1] - dq) / dt


@pytest.mark.parametrize("changes", [{}, PERTURBED, {"mass_scale": 0.5}, {"link_bend": -0.1}, LOADED, LOADED | SLIDING])
@pytest.mark.parametrize("seed", range(3))
def test_it_accelerates_as_pinocchio_in_free_flight(engine, changes, seed):
    robot, (q, dq) = Truth(**changes), random_state(seed)
    with world(engine, robot.parameters, q, dq) as plant:
        measured = acceleration(plant, dq)
    expected = robot.free_acceleration(q, dq, TORQUE)
    assert np.abs(measured - expected).max() <= 1e-9 * np.abs(expected).max()


def test_a_robot_without_stones_falls_freely_and_the_torque_lasts_the_whole_tick(engine):
    """Momentum falls by gravity alone; joint rates change by ten substeps' torque, not one's."""
    robot, q, rates = Truth(), random_state(4)[0], []
    for torque, share in ((np.zeros(4), 1e-3), (TORQUE, 2e-2)):
        with world(engine, robot.parameters, q, np.zeros(7)) as plant:
            plant.advance(torque)
            seen = plant.observe()
        fall = -9.81 * robot.mass * TICK_SECONDS
        assert robot.momentum(seen.q, seen.dq) == pytest.approx([0, fall], abs=share * abs(fall))
        assert not seen.foot_force.any()
        assert not seen.contact.any()
        rates.append(seen.dq)
    gained = robot.free_acceleration(q, np.zeros(7), TORQUE) - robot.free_acceleration(q, np.zeros(7), np.zeros(4))
    assert np.abs(rates[1] - rates[0] - gained * TICK_SECONDS).max() < 0.1 * np.abs(gained * TICK_SECONDS).max()


def test_a_push_acts_at_the_torsos_centre_of_mass(engine):
    """Generalised impulse J' F t, to the 2% that a tick moves the robot."""
    robot = Truth()
    q, arm = random_state(4)[0], 0.24
    ended = []
    for force in (0.0, 200.0):
        with world(engine, robot.parameters, q, np.zeros(7)) as plant:
            plant.push(force, TICK_SECONDS)
            plant.advance(np.zeros(4))
            ended.append(plant.observe().dq)
    impulse = robot.mass_matrix(q) @ (ended[1] - ended[0])
    expected = np.array([1.0, 0, arm * np.cos(q[2]), 0, 0, 0, 0]) * 200.0 * TICK_SECONDS
    assert np.abs(impulse - expected).max() < 0.02 * expected[0]


@pytest.mark.parametrize("changes", [{}, PERTURBED])
@pytest.mark.parametrize("seed", range(3))
def test_stance_follows_the_pinned_model(engine, changes, seed):
    """Over one tick once the rubber has settled, to 2%: the true foot rolls on its sphere and its rubber creeps on."""
    robot = Truth(**changes)
    q, dq = robot.start(seed)
    q[6] += 0.4  # the swing foot stays off the ground until the rubber has settled
    q, dq = project(q, dq, RabbitFeet(leg_shape(robot.parameters)))
    torque = PRESSING * robot.mass / 32
    rigid = RigidPlant(robot.parameters)
    with world(engine, robot.parameters, q, dq, GROUND) as plant:
        for _ in range(SETTLING_TICKS):
            plant.advance(torque)
        settled = plant.observe()
        rigid.reset(settled.q, settled.dq, Leg.LEFT)
        for engine in (rigid, plant):
            engine.advance(torque)
        expected, measured = rigid.observe(), plant.observe()
    change = np.abs(expected.dq - settled.dq).max()
    assert np.abs(measured.dq - expected.dq).max() < 0.02 * change
    size = np.abs(expected.foot_force).max()
    assert np.abs(measured.foot_force - expected.foot_force).max() < 0.02 * size
    assert measured.contact.tolist() == expected.contact.tolist() == [True, False]


def column():
    """Upright on straight legs: forces pass through the joints, so the robot is a block on two feet."""
    q = np.zeros(7)
    q[1] = -RabbitFeet().positions(q)[0, 1]
    return q


@pytest.mark.parametrize("damping", [0.0, 2e3])
def test_the_robot_on_soft_ground_swings_as_a_block_on_a_spring(engine, damping):
    """m z'' = -2 k z - 2 c z' - m g from rest: static sinkage m g / 2 k, damped period; 6% for steps of 1 ms.

    MuJoCo's contact equation has an acceleration: as if each foot carried 1 / R more.
    """
    parameters = SimulationParameters(ground_stiffness=5e4, ground_damping=damping, mass_scale=2.0)
    with world(engine, parameters, column(), np.zeros(7), GROUND) as plant:
        inertia = 64.0
        if engine is MujocoPlant:
            foot = plant.model.geom("left_foot").bodyid[0]
            inertia += 2 / plant.model.body_invweight0[foot, 0]
        heights = [0.0]
        for _ in range(25):
            plant.advance(np.zeros(4))
            heights.append(plant.observe().foot_position[Leg.LEFT, 1])
    t = TICK_SECONDS * np.arange(26)
    static, decay = 64.0 * GRAVITY / 1e5, damping / inertia
    ringing = np.sqrt(1e5 / inertia - decay**2)
    swing = np.exp(-decay * t) * (np.cos(ringing * t) + decay / ringing * np.sin(ringing * t))
    numerical = 0.06 if damping else 0.25  # an undamped swing has only the engine's own damping
    np.testing.assert_allclose(heights, -static * (1 - swing), atol=numerical * static)


def test_dry_friction_holds_a_joint_and_then_takes_its_share(engine):
    """In free fall from rest: 5 N m at every joint against friction of 6 do nothing; 20 act as 14."""
    robot = Truth(coulomb=6.0)
    q, signs = random_state(4)[0], np.array([1.0, -1.0, -1.0, 1.0])
    with world(engine, robot.parameters, q, np.zeros(7)) as plant:
        for _ in range(3):
            plant.advance(5.0 * signs)
        held = plant.observe()
        plant.reset(q, np.zeros(7), Leg.LEFT)
        plant.advance(20.0 * signs)
        slid = plant.observe()
    with world(engine, Truth().parameters, q, np.zeros(7)) as plant:
        plant.advance(14.0 * signs)
        smooth = plant.observe()
    assert (np.sign(slid.dq[3:]) == signs).all()
    assert np.abs(held.q[3:] - q[3:]).max() < 2e-4
    assert slid.dq == pytest.approx(smooth.dq, abs=0.03 * np.abs(smooth.dq[2:]).max())


def test_measured_forces_are_the_momentum_that_the_ground_gives(engine):
    """Sum of forces - m g = dp/dt over a tick with a landing in it; 1% for Bullet's first-order steps."""
    robot = Truth()
    q, dq = robot.start()
    with world(engine, robot.parameters, q, dq, GROUND) as plant:
        touched = False
        for _ in range(120):
            before = robot.momentum(plant.observe().q, plant.observe().dq)
            plant.advance(PRESSING)
            reading = plant.observe()
            gained = robot.momentum(reading.q, reading.dq) - before + [0, robot.mass * 9.81 * TICK_SECONDS]
            given = reading.foot_force.sum(axis=0) * TICK_SECONDS
            assert given == pytest.approx(gained, abs=0.01 * np.abs(gained).max() + 0.05)
            touched |= bool(reading.touches)
            if reading.q[1] < 0.4:
                break
    assert touched


def where_it_slides(plant):
    """The sliding payload ahead of its middle, m."""
    if isinstance(plant, MujocoPlant):
        return plant._data.joint("sliding_payload").qpos[0]
    names = [plant._client.getJointInfo(plant._robot, j)[1] for j in range(plant._client.getNumJoints(plant._robot))]
    return plant._client.getJointState(plant._robot, names.index(b"sliding_payload"))[0]


@pytest.mark.parametrize("push", [-100.0, 100.0])
def test_a_payload_slides_to_its_stop_when_the_torso_is_pushed(engine, push):
    """It stays behind, and the stop takes it along."""
    parameters = SimulationParameters(sliding_payload=2.0, slide_length=0.03)
    with world(engine, parameters, random_state(4)[0], np.zeros(7)) as plant:
        plant.push(push, 0.2)
        ways = []
        for _ in range(20):
            plant.advance(np.zeros(4))
            ways.append(where_it_slides(plant) * np.sign(push))
    assert ways[0] < 0
    assert min(ways) == pytest.approx(-0.03, abs=2e-3)


@pytest.mark.parametrize(("ground", "underfoot"), [(0.3, None), (0.8, None), (1.5, 0.4)])
def test_the_ground_keeps_coulombs_cone_and_a_foot_slides_on_it(engine, ground, underfoot):
    robot = Truth(ground_friction=ground)
    q, dq = standing(robot)
    friction = underfoot or ground
    with world(engine, robot.parameters, q, dq, GROUND) as plant:
        if underfoot:
            plant.set_friction(Leg.LEFT, underfoot)
        for _ in range(8):
            plant.advance(np.array([-150.0, 0.0, 0.0, 0.0]))  # the leg pushes the ground backward
        reading = plant.observe()
    tangential, normal = np.abs(reading.foot_force[Leg.LEFT])
    assert tangential == pytest.approx(friction * normal, rel=0.02)
    assert abs(reading.foot_position[Leg.LEFT, 0]) > 0.005


@pytest.mark.parametrize(("edge", "stands"), [(0.0, True), (-0.0005, True), (-2.5 * FOOT_RADIUS, False)])
def test_a_foot_stands_up_to_the_edge_of_a_real_stone(engine, edge, stands):
    """The stone ends at x = edge under a foot at 0: boxes reach a foot's radius further."""
    q, dq = standing(Truth())
    with world(engine, SimulationParameters(), q, dq, [Span(edge - 0.05, edge)]) as plant:
        for _ in range(3):
            plant.advance(np.zeros(4))
        assert plant.observe().contact[Leg.LEFT] == stands
