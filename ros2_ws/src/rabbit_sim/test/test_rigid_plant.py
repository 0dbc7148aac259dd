"""The pinned model and the rigid plant against the equation of motion, energy, momentum and the impact's identities."""

import numpy as np
import pytest
from pinned_motion import accelerations
from rabbit_description.state import TICK_SECONDS, Leg
from rabbit_sim.kinematics import RabbitFeet
from rabbit_sim.rigid_plant import RigidPlant
from rabbit_sim.robot_urdf import leg_shape, true_mass

PERTURBED = {"mass_scale": 1.7, "payload": 11.0, "payload_height": 0.4, "link_bend": 0.06, "joint_damping": 2.5}
TORQUE = np.array([12.0, 25.0, -20.0, 8.0])
PRESSING = np.array([-10.0, -25.0, 10.0, -10.0])  # keeps the left foot on the ground


@pytest.mark.parametrize("changes", [{}, PERTURBED])
@pytest.mark.parametrize("leg", Leg)
@pytest.mark.parametrize("seed", range(3))
def test_pinned_dynamics_obey_the_equation_of_motion_and_hold_the_foot(random_state, truth, changes, leg, seed):
    robot = truth(**changes)
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
def test_impact_identities(random_state, truth, changes, leg, seed):
    """New stance foot at rest, energy not grown, momentum from the impulse alone, none about the contact."""
    robot = truth(**changes)
    q, dq = random_state(seed)
    after, impulse = robot.pinned().impact(q, dq, leg)
    assert robot.jacobian(q, leg) @ after == pytest.approx([0, 0], abs=1e-12)
    assert robot.energy(q, after) <= robot.energy(q, dq)
    assert robot.momentum(q, after) - robot.momentum(q, dq) == pytest.approx(impulse, rel=1e-9, abs=1e-9)
    contact = RabbitFeet(leg_shape(robot.parameters)).positions(q)[leg]
    before = robot.angular_momentum(q, dq, contact)
    assert robot.angular_momentum(q, after, contact) == pytest.approx(before, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("changes", [{}, {**PERTURBED, "joint_damping": 0.0}])
def test_rigid_keeps_energy_and_its_foot_without_torque(truth, changes):
    robot = truth(plant="rigid", **changes)
    q, dq = robot.start()
    plant = RigidPlant(robot.parameters)
    plant.reset(q, dq, Leg.LEFT)
    for _ in range(8):
        plant.advance(np.zeros(4))
    reading = plant.observe()
    assert reading.contact.tolist() == [True, False]
    assert robot.energy(reading.q, reading.dq) == pytest.approx(robot.energy(q, dq), rel=1e-9)
    assert reading.foot_position[Leg.LEFT] == pytest.approx([0, 0], abs=1e-10)


def test_damping_takes_the_energy_that_its_power_says(truth):
    robot = truth(plant="rigid", joint_damping=3.0)
    q, dq = robot.start()
    power = -3.0 * (robot.mass_matrix(q).diagonal()[3:] * dq[3:] ** 2).sum()
    ddq, _ = accelerations(robot.pinned(), q, dq, np.zeros(4), Leg.LEFT)
    h = 1e-6
    rate = (robot.energy(q + h * dq, dq + h * ddq) - robot.energy(q - h * dq, dq - h * ddq)) / (2 * h)
    assert rate == pytest.approx(power, rel=1e-5)


def fall_until_touch(robot):
    q, dq = robot.start()
    plant = RigidPlant(robot.parameters)
    plant.reset(q, dq, Leg.LEFT)
    for _ in range(200):
        before = plant.observe()
        plant.advance(PRESSING)
        if plant.observe().touches:
            return before, plant.observe()
    raise AssertionError("no foot came down")


@pytest.mark.parametrize("changes", [{}, PERTURBED])
def test_rigid_locates_the_impact_and_pins_the_other_foot(truth, changes):
    robot = truth(plant="rigid", **changes)
    before, after = fall_until_touch(robot)
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
def test_a_slope_is_a_turned_world(truth, slope):
    """In the ground's frame and in the level one the robot does the same; the pinned foot knows no ground."""
    robot, angle = truth(slope=slope, plant="rigid", motor_lag=0.004), np.deg2rad(slope)
    uphill = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])  # from the ground's frame
    q, dq = robot.start()
    tilted, level = RigidPlant(robot.parameters), RigidPlant(truth(plant="rigid", motor_lag=0.004).parameters)
    tilted.reset(q, dq, Leg.LEFT)
    level.reset(np.r_[uphill @ q[:2], q[2] - angle, q[3:]], np.r_[uphill @ dq[:2], dq[2:]], Leg.LEFT)
    for _ in range(5):
        tilted.advance(PRESSING)
        level.advance(PRESSING)
    seen, turned = tilted.observe(), level.observe()
    np.testing.assert_allclose(turned.q, np.r_[uphill @ seen.q[:2], seen.q[2] - angle, seen.q[3:]], atol=1e-9)
    np.testing.assert_allclose(turned.dq, np.r_[uphill @ seen.dq[:2], seen.dq[2:]], atol=1e-9)
    np.testing.assert_allclose(turned.foot_force, seen.foot_force @ uphill.T, atol=1e-6)


def test_loads_weigh_where_they_are(truth):
    """Mass and CoM of the whole robot, and the inertia about it, by Steiner's theorem for each part."""
    plain = truth(mass_scale=1.5)
    loaded = truth(mass_scale=1.5, payload=8.0, payload_ahead=0.1, payload_height=0.3, left_leg_scale=1.3)
    upright = np.zeros(7)
    legs = 0.3 * 1.5 * np.array([6.8, 3.2])  # added to the left thigh and shin
    mass, moment = 48.0 + 8.0 + legs.sum(), 8.0 * np.array([0.1, 0.3]) + np.array([0.0, legs @ [-0.11, -0.64]])
    assert true_mass(loaded.parameters) == pytest.approx(mass)
    assert loaded.mass_matrix(upright)[0, 0] == pytest.approx(mass)
    added = loaded.mass_matrix(upright) - plain.mass_matrix(upright)
    assert added[:2, 2] == pytest.approx([moment[1], -moment[0]])  # of a turn about +y
    about_hip = 8.0 * (0.1**2 + 0.3**2) + legs @ [0.11**2 + 0.47 / 6.8, 0.64**2 + 0.20 / 3.2]
    assert added[2, 2] == pytest.approx(about_hip)
