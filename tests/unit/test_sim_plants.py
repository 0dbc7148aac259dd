"""Both plants against pinocchio, momentum, energy and the impact's identities."""

from contextlib import contextmanager

import numpy as np
import pinocchio
import pytest
from rabbit_description.gait import load_gait
from rabbit_description.state import TICK_SECONDS, Leg
from rabbit_sim.bullet import pybullet
from rabbit_sim.initial_state import initial_state, project
from rabbit_sim.kinematics import LINK_LENGTH, foot_jacobian, foot_positions
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.pinned_dynamics import PinnedDynamics
from rabbit_sim.pybullet_plant import FOOT_RADIUS, PybulletPlant
from rabbit_sim.rigid_plant import RigidPlant
from rabbit_sim.robot_urdf import perturbed_urdf

GAIT = load_gait("authors_035")
PERTURBED = {"mass_scale": 1.7, "payload": 11.0, "payload_height": 0.4, "link_bend": 0.06, "joint_damping": 2.5}
GROUND = [(-5.0, 5.0)]
TORQUE = np.array([12.0, 25.0, -20.0, 8.0])
PRESSING = np.array([-10.0, -25.0, 10.0, -10.0])  # keeps the left foot on the ground


def parameters(**changes):
    return SimulationParameters(**changes)


def pinocchio_of(p):
    model = pinocchio.buildModelFromXML(perturbed_urdf(p))
    return model, model.createData()


def random_state(seed, height=3.0):
    rng = np.random.default_rng(seed)
    q = np.array([0.3, height, 0.1, -0.3, 0.5, -0.3, 0.6]) + rng.uniform(-0.4, 0.4, 7)
    return q, rng.uniform(-4, 4, 7)


def start_state(p, seed=1):
    return initial_state(p, GAIT, np.random.default_rng(seed))


@contextmanager
def bullet(p, q, dq, spans=()):
    plant = PybulletPlant(p)
    try:
        plant.reset(q, dq, Leg.LEFT)
        plant.set_stones(spans)
        yield plant
    finally:
        plant.close()


def free_acceleration(p, q, dq, torque):
    """From the equation of motion, the damping as the documents give it."""
    model, data = pinocchio_of(p)
    mass = pinocchio.crba(model, data, q)
    force = np.r_[np.zeros(3), torque - p.joint_damping * mass.diagonal()[3:] * dq[3:]]
    return pinocchio.aba(model, data, q, dq, force)


def energy(p, q, dq):
    model, data = pinocchio_of(p)
    return pinocchio.computeKineticEnergy(model, data, q, dq) + pinocchio.computePotentialEnergy(model, data, q)


def momentum(p, q, dq):
    """Linear momentum, x and z."""
    model, data = pinocchio_of(p)
    return np.asarray(pinocchio.computeCentroidalMomentum(model, data, q, dq).linear)[[0, 2]]


def angular_momentum(p, q, dq, point):
    """About +y and a point (x, z)."""
    model, data = pinocchio_of(p)
    about_com = pinocchio.computeCentroidalMomentum(model, data, q, dq)
    arm = np.asarray(data.com[0])[[0, 2]] - point
    linear = np.asarray(about_com.linear)[[0, 2]]
    return about_com.angular[1] + arm[1] * linear[0] - arm[0] * linear[1]


def total_mass(p):
    return 32.0 * p.mass_scale + p.payload


# ---- free flight -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("changes", [{}, PERTURBED, {"mass_scale": 0.5}, {"link_bend": -0.1}])
@pytest.mark.parametrize("seed", range(3))
def test_pybullet_accelerates_as_pinocchio_in_free_flight(changes, seed):
    """Bullet's new velocity is v + dt a(q, v): one short step gives `a` up to rounding in v / dt."""
    p, dt = parameters(**changes), 1e-5
    q, dq = random_state(seed)
    with bullet(p, q, dq) as plant:
        pybullet.setTimeStep(dt, physicsClientId=plant._client)
        plant._apply(TORQUE)
        pybullet.stepSimulation(physicsClientId=plant._client)
        measured = (plant._joint_states()[1] - dq) / dt
    expected = free_acceleration(p, q, dq, TORQUE)
    assert np.abs(measured - expected).max() <= 1e-9 * np.abs(expected).max()


def test_a_robot_without_stones_falls_freely_and_the_torque_lasts_the_whole_tick():
    """Momentum falls by gravity alone; joint rates change by ten substeps' torque, not one's."""
    p = parameters()
    q = random_state(4)[0]
    with bullet(p, q, np.zeros(7)) as plant:
        plant.advance(np.zeros(4))
        free = plant.observe()
        plant.reset(q, np.zeros(7), Leg.LEFT)
        plant.advance(TORQUE)
        driven = plant.observe()
    fall = -9.81 * total_mass(p) * TICK_SECONDS
    assert momentum(p, free.q, free.dq) == pytest.approx([0, fall], abs=1e-3 * abs(fall))
    assert momentum(p, driven.q, driven.dq) == pytest.approx([0, fall], abs=2e-2 * abs(fall))
    gained = free_acceleration(p, q, np.zeros(7), TORQUE) - free_acceleration(p, q, np.zeros(7), np.zeros(4))
    assert np.abs(driven.dq - free.dq - gained * TICK_SECONDS).max() < 0.1 * np.abs(gained * TICK_SECONDS).max()
    assert not driven.foot_force.any()
    assert not driven.contact.any()


def test_robot_parts_but_feet_collide_with_nothing():
    """With its hips below the ground's top and its feet above any ground there is no force."""
    q = np.array([0, -0.3, 0, np.pi - 0.3, 0.2, np.pi + 0.3, -0.2])
    with bullet(parameters(), q, np.zeros(7), [(-0.05, 0.05)]) as plant:
        assert plant.observe().foot_position[:, 1].min() > 0.2
        plant.advance(np.zeros(4))
        assert not plant.observe().foot_force.any()


# ---- stance ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("changes", [{}, PERTURBED])
@pytest.mark.parametrize("seed", range(3))
def test_pybullet_in_stance_follows_the_pinned_model(changes, seed):
    """Over one tick, to the foot's radius over a link's length: the true foot is a sphere that rolls."""
    p = parameters(**changes)
    q, dq = start_state(p, seed)
    q[6] += 0.2  # the swing foot well off the ground
    q, dq = project(q, dq, p.link_bend)
    torque = PRESSING * total_mass(p) / 32
    rigid = RigidPlant(p)
    rigid.reset(q, dq, Leg.LEFT)
    with bullet(p, q, dq, GROUND) as plant:
        for each in (rigid, plant):
            each.advance(torque)
        expected, measured = rigid.observe(), plant.observe()
    tolerance, change = FOOT_RADIUS / LINK_LENGTH, np.abs(expected.dq - dq).max()
    assert np.abs(measured.dq - expected.dq).max() < tolerance * change
    size = np.abs(expected.foot_force).max()
    assert np.abs(measured.foot_force - expected.foot_force).max() < tolerance * size
    assert measured.contact.tolist() == expected.contact.tolist() == [True, False]


def test_measured_forces_are_the_momentum_that_the_ground_gives():
    """Sum of forces - m g = dp/dt over a tick with a landing in it; 1% for Bullet's first-order steps."""
    p = parameters()
    q, dq = start_state(p)
    with bullet(p, q, dq, GROUND) as plant:
        touched = False
        for _ in range(120):
            before = momentum(p, plant.observe().q, plant.observe().dq)
            plant.advance(PRESSING)
            reading = plant.observe()
            gained = momentum(p, reading.q, reading.dq) - before + [0, total_mass(p) * 9.81 * TICK_SECONDS]
            given = reading.foot_force.sum(axis=0) * TICK_SECONDS
            assert given == pytest.approx(gained, abs=0.01 * np.abs(gained).max() + 0.05)
            touched |= bool(reading.touches)
            if reading.q[1] < 0.4:
                break
    assert touched


@pytest.mark.parametrize("friction", [0.3, 0.8])
def test_pybullet_keeps_coulombs_cone_and_slides_on_it(friction):
    p = parameters(ground_friction=friction)
    q, _ = start_state(p)
    q, dq = project(q, np.zeros(7), 0.0)
    with bullet(p, q, dq, GROUND) as plant:
        for _ in range(8):
            plant.advance(np.array([-150.0, 0.0, 0.0, 0.0]))  # the leg pushes the ground backward
        reading = plant.observe()
    tangential, normal = np.abs(reading.foot_force[Leg.LEFT])
    assert tangential == pytest.approx(friction * normal, rel=0.02)
    assert abs(reading.foot_position[Leg.LEFT, 0]) > 0.005


@pytest.mark.parametrize(("edge", "stands"), [(0.0, True), (-0.0005, True), (-2.5 * FOOT_RADIUS, False)])
def test_a_foot_stands_up_to_the_edge_of_a_real_stone(edge, stands):
    """The stone ends at x = edge under a foot at 0: boxes reach a foot's radius further."""
    q, _ = start_state(parameters())
    q, dq = project(q, np.zeros(7), 0.0)
    with bullet(parameters(), q, dq, [(edge - 0.05, edge)]) as plant:
        for _ in range(3):
            plant.advance(np.zeros(4))
        assert plant.observe().contact[Leg.LEFT] == stands


def test_a_foot_falls_into_a_real_gap_and_the_other_finds_its_stone():
    q = np.array([0.0, 0.0, 0.0, 0.3, 0.0, -0.3, 0.0])
    q[1] = 0.03 - foot_positions(q)[0, 1]
    left, right = foot_positions(q)[:, 0]
    with bullet(parameters(), q, np.zeros(7), [(left - 0.03, left + 0.03), (right + 0.02, right + 0.1)]) as plant:
        touches = []
        for _ in range(12):
            plant.advance(np.zeros(4))
            touches += plant.observe().touches
    by_leg = {touch.leg: touch for touch in touches}
    assert len(touches) == 2
    assert by_leg[Leg.LEFT].hold
    assert not by_leg[Leg.RIGHT].hold
    assert by_leg[Leg.RIGHT].x == pytest.approx(right, abs=0.01)
    assert by_leg[Leg.RIGHT].other_x == pytest.approx(left, abs=0.01)


def test_a_foot_on_the_ground_is_no_touch():
    q, dq = start_state(parameters())
    with bullet(parameters(), q, dq, GROUND) as plant:
        for _ in range(3):
            plant.advance(np.zeros(4))
            assert plant.observe().touches == ()


def test_pybullet_repeats_itself_bit_for_bit():
    """After another episode in the same plant, and in a second plant beside it."""
    p = parameters()
    q, dq = start_state(p)
    runs = []
    with bullet(p, q, dq, GROUND) as first, bullet(p, q, dq, GROUND) as second:
        for plant, again in ((first, False), (first, True), (second, False)):
            if again:
                plant.reset(q, dq, Leg.LEFT)
                plant.set_stones(GROUND)
            for _ in range(40):
                plant.advance(TORQUE)
            runs.append(np.r_[plant.observe().q, plant.observe().dq, plant.observe().foot_force.ravel()])
    assert (runs[0] == runs[1]).all()
    assert (runs[0] == runs[2]).all()


def test_closing_twice_is_harmless():
    plant = PybulletPlant(parameters())
    plant.close()
    plant.close()


# ---- the pinned model ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("changes", [{}, PERTURBED])
@pytest.mark.parametrize("leg", Leg)
@pytest.mark.parametrize("seed", range(3))
def test_pinned_dynamics_obey_the_equation_of_motion_and_hold_the_foot(changes, leg, seed):
    p = parameters(**changes)
    q, dq = random_state(seed)
    ddq, force = PinnedDynamics(perturbed_urdf(p), p.link_bend, p.joint_damping).accelerations(q, dq, TORQUE, leg)
    jacobian, h = foot_jacobian(q, leg, p.link_bend), 1e-6
    drift = (foot_jacobian(q + h * dq, leg, p.link_bend) - foot_jacobian(q - h * dq, leg, p.link_bend)) / (2 * h) @ dq
    assert jacobian @ ddq + drift == pytest.approx([0, 0], abs=1e-6)
    model, data = pinocchio_of(p)
    pinocchio.aba(model, data, q, dq, np.zeros(7))
    pushed = free_acceleration(p, q, dq, TORQUE) + np.linalg.solve(pinocchio.crba(model, data, q), jacobian.T @ force)
    assert ddq == pytest.approx(pushed, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("scale", [0.5, 2.0, 3.0])
def test_mass_scale_with_scaled_torque_moves_alike_and_scales_the_forces(scale):
    q, dq = random_state(1)
    nominal = PinnedDynamics(perturbed_urdf(parameters()))
    heavy = PinnedDynamics(perturbed_urdf(parameters(mass_scale=scale)))
    ddq, force = nominal.accelerations(q, dq, TORQUE, Leg.LEFT)
    scaled_ddq, scaled_force = heavy.accelerations(q, dq, scale * TORQUE, Leg.LEFT)
    assert scaled_ddq == pytest.approx(ddq, rel=1e-9)
    assert scaled_force == pytest.approx(scale * force, rel=1e-9)


@pytest.mark.parametrize("changes", [{}, PERTURBED])
@pytest.mark.parametrize("leg", Leg)
@pytest.mark.parametrize("seed", range(5))
def test_impact_identities(changes, leg, seed):
    """New stance foot at rest, energy not grown, momentum from the impulse alone, none about the contact."""
    p = parameters(**changes)
    q, dq = random_state(seed)
    after, impulse = PinnedDynamics(perturbed_urdf(p), p.link_bend).impact(q, dq, leg)
    assert foot_jacobian(q, leg, p.link_bend) @ after == pytest.approx([0, 0], abs=1e-12)
    assert energy(p, q, after) <= energy(p, q, dq)
    assert momentum(p, q, after) - momentum(p, q, dq) == pytest.approx(impulse, rel=1e-9, abs=1e-9)
    contact = foot_positions(q, p.link_bend)[leg]
    before = angular_momentum(p, q, dq, contact)
    assert angular_momentum(p, q, after, contact) == pytest.approx(before, rel=1e-9, abs=1e-9)


def test_impact_of_a_foot_at_rest_changes_nothing():
    q, dq = start_state(parameters())
    after, impulse = PinnedDynamics(perturbed_urdf(parameters())).impact(q, dq, Leg.LEFT)
    assert after == pytest.approx(dq, abs=1e-12)
    assert impulse == pytest.approx([0, 0], abs=1e-10)


# ---- the rigid plant -------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("changes", [{}, {**PERTURBED, "joint_damping": 0.0}])
def test_rigid_keeps_energy_and_its_foot_without_torque(changes):
    p = parameters(plant="rigid", **changes)
    q, dq = start_state(p)
    plant = RigidPlant(p)
    plant.reset(q, dq, Leg.LEFT)
    for _ in range(8):
        plant.advance(np.zeros(4))
    reading = plant.observe()
    assert reading.contact.tolist() == [True, False]
    assert energy(p, reading.q, reading.dq) == pytest.approx(energy(p, q, dq), rel=1e-9)
    assert reading.foot_position[Leg.LEFT] == pytest.approx([0, 0], abs=1e-10)


def test_damping_takes_the_energy_that_its_power_says():
    p = parameters(plant="rigid", joint_damping=3.0)
    q, dq = start_state(p)
    model, data = pinocchio_of(p)
    power = -3.0 * (pinocchio.crba(model, data, q).diagonal()[3:] * dq[3:] ** 2).sum()
    ddq, _ = PinnedDynamics(perturbed_urdf(p), 0.0, 3.0).accelerations(q, dq, np.zeros(4), Leg.LEFT)
    h = 1e-6
    rate = (energy(p, q + h * dq, dq + h * ddq) - energy(p, q - h * dq, dq - h * ddq)) / (2 * h)
    assert rate == pytest.approx(power, rel=1e-5)


def fall_until_touch(p):
    q, dq = start_state(p)
    plant = RigidPlant(p)
    plant.reset(q, dq, Leg.LEFT)
    for _ in range(200):
        before = plant.observe()
        plant.advance(PRESSING)
        if plant.observe().touches:
            return before, plant.observe()
    raise AssertionError("no foot came down")


@pytest.mark.parametrize("changes", [{}, PERTURBED])
def test_rigid_locates_the_impact_and_pins_the_other_foot(changes):
    p = parameters(plant="rigid", **changes)
    before, after = fall_until_touch(p)
    (touch,) = after.touches
    assert touch.leg is Leg.RIGHT
    assert after.foot_position[Leg.RIGHT] == pytest.approx([touch.x, 0], abs=1e-9)
    assert touch.other_x == pytest.approx(0, abs=1e-9)
    assert after.contact.tolist() == [False, True]
    assert foot_jacobian(after.q, Leg.RIGHT, p.link_bend) @ after.dq == pytest.approx([0, 0], abs=1e-9)
    gained = momentum(p, after.q, after.dq) - momentum(p, before.q, before.dq)
    given = after.foot_force.sum(axis=0) * TICK_SECONDS - [0, total_mass(p) * 9.81 * TICK_SECONDS]
    assert given == pytest.approx(gained, rel=1e-7)


def test_rigid_mean_force_is_the_momentum_over_the_tick():
    p = parameters(plant="rigid")
    q, dq = start_state(p)
    plant = RigidPlant(p)
    plant.reset(q, dq, Leg.LEFT)
    plant.advance(TORQUE)
    reading = plant.observe()
    gained = momentum(p, reading.q, reading.dq) - momentum(p, q, dq)
    weight = [0, total_mass(p) * 9.81 * TICK_SECONDS]
    assert reading.foot_force[Leg.LEFT] * TICK_SECONDS == pytest.approx(gained + weight, rel=1e-8)
    assert not reading.foot_force[Leg.RIGHT].any()
