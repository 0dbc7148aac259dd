"""Identification of the robot from its motion, against robots whose parameters are known."""

import numpy as np
import pinocchio as pin
import pytest
from rabbit_description.state import TICK_SECONDS
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.robot_urdf import perturbed_urdf
from rl_cbf_clf_controller.identification import DAMPING, MOTOR_GAIN, THETA, Identification
from rl_cbf_clf_controller.least_squares import LeastSquares
from rl_cbf_clf_controller.link_parameters import motion_regressor, read_links, write_links
from rl_cbf_clf_controller.nominal_model import NominalModel

POSE = np.array([0.0, 0.75, 0.1, -0.3, 0.5, -0.3, 0.6])
LATE = 0.33  # of a tick's change of torque, that arrives a tick late
PLANTS = [
    {"mass_scale": 2.0},
    {"mass_scale": 0.5},
    {"payload": 48.0},
    {"mass_scale": 2.0, "motor_loss": 0.15},
    {"mass_scale": 2.0, "joint_damping": 1.0},
]


def robot(**plant) -> NominalModel:
    parameters = SimulationParameters(**plant)
    return NominalModel(perturbed_urdf(parameters), 1 - parameters.motor_loss, parameters.joint_damping)


def random_state(rng):
    return POSE + rng.uniform(-0.3, 0.3, 7), rng.uniform(-3, 3, 7)


def walk_about(true: NominalModel, identification: Identification, ticks: int) -> None:
    """Ticks whose mean motion is the true robot's exactly, in poses at random."""
    rng, before = np.random.default_rng(5), np.zeros(4)
    for _ in range(ticks):
        (q, dq), u = random_state(rng), rng.normal(0, 40, 4)
        true.update(q, dq)
        dynamics = true.pinned()
        arrived = u + LATE * (before - u)
        ddq, force = dynamics.acceleration(arrived), dynamics.force(arrived)
        half = TICK_SECONDS / 2
        ends = [(q - half * dq, dq - half * ddq), (q + half * dq, dq + half * ddq)]
        identification.learn(*ends, (before, u), np.array([force, [0.0, 0.0]]))
        before = u


def test_the_regressor_times_the_links_is_the_inverse_dynamics():
    rng = np.random.default_rng(0)
    for plant in ({}, {"payload": 30.0}, {"mass_scale": 0.7}):
        model = robot(**plant).model
        data = model.createData()
        (q, dq), ddq = random_state(rng), rng.normal(0, 20, 7)
        expected = pin.rnea(model, model.createData(), q, dq, ddq)
        assert motion_regressor(model, data, q, dq, ddq) @ read_links(model) == pytest.approx(expected, abs=1e-9)


def test_links_written_are_a_robot_with_those_links():
    nominal, heavy = robot().model, robot(payload=30.0).model
    write_links(nominal, read_links(heavy))
    q, dq = random_state(np.random.default_rng(1))
    for ddq in np.eye(7):
        there = pin.rnea(heavy, heavy.createData(), q, dq, ddq)
        assert pin.rnea(nominal, nominal.createData(), q, dq, ddq) == pytest.approx(there, abs=1e-9)


def test_a_payload_is_a_mass_on_the_torso_alone():
    change = read_links(robot(payload=30.0).model) - read_links(robot().model)
    assert change == pytest.approx([30.0, 0, 30.0 * 0.24, 30.0 * 0.24**2] + 8 * [0.0])


@pytest.mark.parametrize("plant", PLANTS)
def test_a_robot_is_found_from_its_motion(plant):
    true, identification = robot(**plant), Identification(robot().model)
    walk_about(true, identification, 300)
    found = robot()
    value = identification.value
    write_links(found.model, value[THETA])
    found.motor_gain, found.joint_damping = value[MOTOR_GAIN], value[DAMPING]
    assert value[MOTOR_GAIN] == pytest.approx(1 - plant.get("motor_loss", 0.0), abs=0.02)
    assert value[DAMPING] == pytest.approx(plant.get("joint_damping", 0.0), abs=0.05)
    assert value[-1] == pytest.approx(LATE * value[MOTOR_GAIN], abs=0.02)
    state, u = random_state(np.random.default_rng(9)), np.array([10.0, -20.0, 30.0, 5.0])
    for each in (true, found):
        each.update(*state)
    expected, known = true.pinned(), found.pinned()
    assert known.acceleration(u) == pytest.approx(expected.acceleration(u), rel=0.03, abs=0.5)
    assert known.force(u) == pytest.approx(expected.force(u), rel=0.02, abs=3.0)


def test_the_nominal_robot_is_left_as_it_is():
    identification = Identification(robot().model)
    start = identification.value.copy()
    assert start == pytest.approx(np.concatenate([read_links(robot().model), [0.0, 1.0, 0.0]]))
    true = robot()
    for _ in range(3):
        walk_about(true, identification, 1)  # each alone: the torque before is 0, as it was
        identification.interrupt()
    assert identification.value[THETA][::4] == pytest.approx(start[THETA][::4], rel=0.02)


def test_reset_forgets():
    identification = Identification(robot().model)
    start = identification.value.copy()
    walk_about(robot(mass_scale=2.0), identification, 5)
    assert not np.allclose(identification.value, start)
    identification.reset()
    np.testing.assert_array_equal(identification.value, start)


def test_least_squares_solve_the_normal_equations():
    """Without noise in x: the weighted mean of what was believed and all that was measured."""
    rng = np.random.default_rng(2)
    start, prior, noise = rng.normal(size=3), np.diag([1.0, 2.0, 3.0]), np.diag([0.5, 0.2])
    fit = LeastSquares(start, prior, np.zeros((3, 3)))
    information, known = np.linalg.inv(prior), np.linalg.solve(prior, start)
    for _ in range(4):
        H, z = rng.normal(size=(2, 3)), rng.normal(size=2)
        fit.update(H, z, noise)
        information = information + H.T @ np.linalg.solve(noise, H)
        known = known + H.T @ np.linalg.solve(noise, z)
    assert fit.value == pytest.approx(np.linalg.solve(information, known))


def test_least_squares_keep_what_is_not_measured():
    fit = LeastSquares(np.array([1.0, 2.0]), np.eye(2), np.zeros((2, 2)))
    for _ in range(5):
        fit.update(np.array([[1.0, 0.0]]), np.array([3.0]), 1e-9 * np.eye(1))
    assert fit.value == pytest.approx([3.0, 2.0])
