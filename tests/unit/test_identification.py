"""Identification of the robot from its motion, and of its joints' angles, against robots that are known."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from cbf_clf_qp.functions import NumpyFunction, packed
from rabbit_description.state import TICK_SECONDS
from rabbit_gait_design.pinocchio_model import PinocchioModel
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.robot_urdf import perturbed_urdf
from rl_cbf_clf_controller.identification import (
    BASE_DOUBT,
    DAMPING,
    MOTOR_GAIN,
    RATE_NOISE,
    THETA,
    USUAL_LATE,
    in_use,
    learned,
    shares,
    unknown,
)
from rl_cbf_clf_controller.joint_calibration import OFFSETS, UNKNOWN, calibrated
from rl_cbf_clf_controller.least_squares import updated
from rl_cbf_clf_controller.planar_robot import PinnedRobot
from rl_cbf_clf_controller.robot_numbers import RobotNumbers, read_robot

POSE = np.array([0.0, 0.75, 0.1, -0.3, 0.5, -0.3, 0.6])
LATE = 0.33  # of a tick's change of torque, that arrives a tick late
PLANTS = [
    {"mass_scale": 2.0},
    {"mass_scale": 0.5},
    {"payload": 48.0},
    {"mass_scale": 2.0, "motor_loss": 0.15},
    {"mass_scale": 2.0, "joint_damping": 1.0},
]


def robot(**plant) -> PinocchioModel:
    parameters = SimulationParameters(**plant)
    return PinocchioModel(perturbed_urdf(parameters), 1 - parameters.motor_loss, parameters.joint_damping)


def numbers(**plant) -> RobotNumbers:
    """Of the robot, its motors and joints apart."""
    return read_robot(perturbed_urdf(SimulationParameters(**plant)))


class Identification:
    """What is `known` of a robot that begins as this one, tick by tick."""

    def __init__(self, robot: RobotNumbers) -> None:
        first, self._lengths = unknown(robot), (robot.joints, robot.feet)
        self._first = np.concatenate([value.ravel() for value in first.values()])
        known = symbols({name: value.shape for name, value in first.items()})
        shapes = {"start": (14,), "end": (14,), "before": (4,), "now": (4,), "force": (2, 2), "rate_variance": (1,)}
        tick = symbols({**shapes, "joints": (4, 2), "feet": (2, 2)})
        found = learned(robot, known, {**tick, "learns": ca.SX(1)})
        inputs = {"known": packed(known), **tick}
        self._learned = NumpyFunction.of("learned", inputs, {name: found[name] for name in first})
        self.reset()

    def reset(self) -> None:
        self.known = self._learned.values(self._first.copy())

    def learn(self, start, end, torques, force) -> None:
        variance = np.array([RATE_NOISE**2])
        self.known = self._learned(self.known.row, start, end, *torques, force, variance, *self._lengths)


def symbols(shapes: dict[str, tuple[int, ...]]) -> dict[str, ca.SX]:
    return {name: ca.SX.sym(name, *shape) for name, shape in shapes.items()}


def used(doubts: np.ndarray) -> tuple[np.ndarray, float]:
    """The robot in use of one found, 3, the base's, 2, and the nominal one, 4; how little the one found counts."""
    value, disbelief = in_use(ca.DM.ones(15) * 3, ca.DM.ones(12) * 2, np.full(15, 4.0), ca.DM(doubts))
    return value.full().ravel(), float(disbelief)


def random_state(rng):
    return POSE + rng.uniform(-0.3, 0.3, 7), rng.uniform(-3, 3, 7)


def walk_about(
    true: PinocchioModel, identification: Identification, ticks: int, pull: float = 0.0, sticks: bool = False
) -> None:
    """Ticks whose mean motion is the true robot's exactly, in poses at random.

    A cable pulls at its joints, N m. If their encoders stick, they say in every third tick what they said before.
    """
    joints, said = np.r_[3:7, 10:14], np.zeros((2, 14))
    rng, before = np.random.default_rng(5), np.zeros(4)
    for tick in range(ticks):
        (q, dq), u = random_state(rng), rng.normal(0, 40, 4)
        true.update(q, dq)
        dynamics = true.pinned()
        arrived = u + LATE * (before - u) + pull
        ddq, force = dynamics.acceleration(arrived), dynamics.force(arrived)
        half = TICK_SECONDS / 2
        ends = np.array([np.concatenate([q + side * dq, dq + side * ddq]) for side in (-half, half)])
        if sticks and tick % 3 == 2:
            ends[:, joints] = said[:, joints]
        said = ends
        identification.learn(*ends, (before, u), np.array([force, [0.0, 0.0]]))
        before = u


def test_the_motion_is_linear_in_the_links():
    """tau = Y theta is the inverse dynamics, by pinocchio."""
    own, ddq = PinnedRobot(), ca.SX.sym("ddq", 7)
    links, p = own.parameters["links"], {**own.parameters, "ddq": ddq}
    tau = own.inverse_dynamics(ddq)
    Y = ca.jacobian(tau, ca.vec(links.T))
    inputs = {"q": own.q, "dq": own.dq, **{name: p[name] for name in ("joints", "feet", "gravity", "ddq")}}
    regressor, rng = NumpyFunction.of("regressor", inputs, {"Y": Y}), np.random.default_rng(0)
    for plant in ({}, {"payload": 30.0}, {"mass_scale": 0.7}):
        model, known = robot(**plant).model, numbers(**plant)
        (q, dq), ddq_now = random_state(rng), rng.normal(0, 20, 7)
        expected = pin.rnea(model, model.createData(), q, dq, ddq_now)
        found = regressor(q, dq, known.joints, known.feet, known.gravity, ddq_now).Y @ known.links.ravel()
        assert found == pytest.approx(expected, abs=1e-9)


@pytest.mark.parametrize("plant", PLANTS)
def test_a_robot_is_found_from_its_motion(plant, accelerations):
    identification = Identification(numbers())
    walk_about(robot(**plant), identification, 300)
    value = identification.known.value
    assert value[MOTOR_GAIN] == pytest.approx(1 - plant.get("motor_loss", 0.0), abs=0.02)
    assert value[DAMPING] == pytest.approx(plant.get("joint_damping", 0.0), abs=0.05)
    assert value[-1] == pytest.approx(LATE * value[MOTOR_GAIN], abs=0.02)
    (q, dq), u = random_state(np.random.default_rng(9)), np.array([10.0, -20.0, 30.0, 5.0])
    true = robot(**plant)
    true.update(q, dq)
    found = {"motor_gain": np.full(4, value[MOTOR_GAIN]), "joint_damping": value[DAMPING]}
    found["links"] = value[THETA].reshape(3, 4)[[0, 1, 2, 1, 2]]
    known = accelerations(q, dq, replace(numbers(), **found).row, u)
    assert known.acceleration == pytest.approx(true.pinned().acceleration(u), rel=0.03, abs=0.5)
    assert known.force == pytest.approx(true.pinned().force(u), rel=0.02, abs=3.0)


@pytest.fixture(scope="module")
def accelerations() -> NumpyFunction:
    """q'' and the ground's force of (q, dq, robot's row, torque)."""
    own = PinnedRobot()
    robot = ca.vertcat(*(ca.vec(parameter.T) for parameter in own.parameters.values()))
    inputs = {"q": own.q, "dq": own.dq, "robot": robot}
    found = {"acceleration": own.acceleration(own.u), "force": own.force(own.u)}
    return NumpyFunction.of("accelerations", {**inputs, "u": own.u}, found)


def updating(n: int, m: int) -> NumpyFunction:
    """`updated` of n numbers from m measurements, for numpy."""
    shapes = {"value": (n, 1), "covariance": (n, n), "walk": (n, n), "H": (m, n), "z": (m, 1), "noise": (m, m)}
    found = dict(zip(("value", "covariance", "square"), updated(*(inputs := symbols(shapes)).values()), strict=True))
    return NumpyFunction.of("updated", inputs, found, matrices=("covariance",))


def test_least_squares_solve_the_normal_equations():
    """Without noise in x: the weighted mean of the prior and all that was measured."""
    rng = np.random.default_rng(2)
    start, prior, noise = rng.normal(size=3), np.diag([1.0, 2.0, 3.0]), np.diag([0.5, 0.2])
    value, covariance, still = start, prior, np.zeros((3, 3))
    information, known = np.linalg.inv(prior), np.linalg.solve(prior, start)
    step = updating(3, 2)
    for _ in range(4):
        H, z = rng.normal(size=(2, 3)), rng.normal(size=2)
        found = step(value, covariance, still, H, z, noise)
        value, covariance = found.value, found.covariance
        information = information + H.T @ np.linalg.solve(noise, H)
        known = known + H.T @ np.linalg.solve(noise, z)
    assert value == pytest.approx(np.linalg.solve(information, known))


@pytest.mark.parametrize("wrong", [np.nan, np.inf])
def test_least_squares_keep_all_where_a_number_is_too_large_to_compute_with(wrong):
    start, prior = np.array([1.0, 2.0]), np.eye(2)
    found = updating(2, 1)(start, prior, np.eye(2), np.array([[1.0, wrong]]), np.array([3.0]), np.eye(1))
    np.testing.assert_array_equal(found.value, start)
    np.testing.assert_array_equal(found.covariance, prior)


def test_an_innovation_has_a_mean_square_of_one():
    """If the measurements are as the least squares take them: Gaussian, with the covariance that they are told."""
    step, R, rng, squares = updating(2, 3), np.diag([0.1, 1.0, 4.0]), np.random.default_rng(8), []
    for _ in range(400):
        truth, found, covariance = rng.normal(size=2), np.zeros(2), np.eye(2)
        for _ in range(10):
            rows = rng.normal(size=(3, 2))
            measured = rows @ truth + rng.normal(size=3) * np.sqrt(R.diagonal())
            later = step(found, covariance, np.zeros((2, 2)), rows, measured, R)
            found, covariance = later.value, later.covariance
            squares.append(later.square.item())
    assert np.mean(squares) == pytest.approx(1, abs=4 * np.sqrt(2 / 3 / len(squares)))  # of chi-squared / 3


def test_masses_are_believed_and_a_cable_at_the_joints_is_doubted():
    """No torque at a joint acts in the base's rows, so they say the masses all the same."""
    for pull, expected in ((0.0, 0.0), (40.0, 1.0)):
        identification = Identification(numbers())
        walk_about(robot(mass_scale=2.0), identification, 100, pull)
        known = identification.known
        assert used(known.doubts)[1] == expected
        assert known.doubts[1] == 0
        assert total(known.base) == pytest.approx(2 * total(numbers().theta), rel=0.01)
    identification.reset()
    assert used(identification.known.doubts)[1] == 0


def test_an_encoder_that_sticks_is_seen_in_the_rows_of_the_base_too():
    """So what these rows say is not used."""
    identification = Identification(numbers())
    walk_about(robot(mass_scale=2.0), identification, 100, sticks=True)
    doubt, of_base = identification.known.doubts
    assert doubt > 0.3
    assert of_base > BASE_DOUBT
    assert float(shares(ca.DM(identification.known.doubts))[0]) == 0


def total(theta):
    """The mass of torso and both legs."""
    torso, thigh, shin = theta.reshape(3, -1)[:, 0]
    return torso + 2 * thigh + 2 * shin


def test_what_takes_the_place_of_a_robot_that_is_doubted():
    """The base's rows where they are explained, or else the nominal robot."""
    for doubts, expected in (((0.0, 0.0), 3), ((0.15, 1.0), 3), ((0.3, 0.0), 2), ((0.225, 0.0), 2.5), ((0.6, 0.05), 4)):
        assert used(np.array(doubts))[0][THETA] == pytest.approx(expected)
    assert used(np.array([0.3, 0.0]))[0][THETA.stop :] == pytest.approx([0, 1, USUAL_LATE])


@pytest.mark.parametrize("bend", [0.05, -0.05, 0.0])
def test_a_bent_leg_is_a_turned_hip(bend):
    """To first order in the bend: what is left is below its square times the leg's length."""
    q, dq = random_state(np.random.default_rng(1))
    true = PinocchioModel(perturbed_urdf(SimulationParameters(link_bend=bend))).update(q, dq)
    nominal = PinocchioModel().update(q - OFFSETS @ np.array([bend, 0.0]), dq)
    assert nominal.hip == pytest.approx(true.hip, abs=0.8 * bend**2 + 1e-12)
    assert nominal.swing == pytest.approx(true.swing, abs=1.6 * bend**2 + 1e-12)


def found_after(steps, offsets, foot_velocity):
    """What is known after so many random states of a robot with these offsets, whose foot moves so at step k."""
    model, rng = PinocchioModel(), np.random.default_rng(2)
    shapes = {name: (*np.shape(value), 1)[:2] for name, value in UNKNOWN.items()}
    shapes |= {"x": (14, 1), "ticks": (1, 1), "noise": (1, 1), "joints": (4, 2), "feet": (2, 2)}
    s = symbols(shapes)
    given = [s[name] for name in ("x", "ticks", "noise", "joints", "feet")]
    step, robot, known = NumpyFunction.of("calibrated", s, calibrated(s, *given)), read_robot(), list(UNKNOWN.values())
    for k in range(steps):
        q, dq = random_state(rng)
        dq[:2] = model.update(q, dq).hip_rate + (0.0, foot_velocity(k))
        x = np.concatenate([q + OFFSETS @ (offsets - known[0]), dq])
        after = step(*known, x, np.array([k + 1.0]), np.zeros(1), robot.joints, robot.feet)
        known = [getattr(after, name) for name in UNKNOWN]
    return dict(zip(UNKNOWN, known, strict=True))


@pytest.mark.parametrize("offset", [0.05, -0.03, 0.0])
def test_the_offset_is_found_while_the_foot_stands(offset):
    found = found_after(200, np.array([offset, 0.0]), lambda k: 0.0)
    assert found["offsets"] == pytest.approx([offset, 0.0], abs=1e-3)
    assert found["stands"] == 1.0


@pytest.mark.parametrize("steps", [6, 200])
def test_a_foot_that_sinks_is_no_offset(steps):
    """700 N on ground of 5e4 N/m and 2e3 N s/m, of which a new step loads another spot each 40 ticks."""
    stiffness, damping, load = 5e4, 2e3, 700.0
    found = found_after(steps, np.zeros(2), lambda k: -load / damping * np.exp(-stiffness / damping * 0.01 * (k % 40)))
    assert found["stands"] == 0.0
    assert np.all(found["offsets"] == 0.0)
    assert np.abs(found["offset_fit"]).max() > 0.002  # which the least squares do make of it
