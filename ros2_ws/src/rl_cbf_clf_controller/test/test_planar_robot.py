"""The pinned robot against physics and its peer by pinocchio: motion, constraint, energy and impact identities."""

import re
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.functions import NumpyFunction, packed
from rabbit_description import URDF_PATH
from rabbit_description.planar_urdf import with_planar_base
from rabbit_description.state import ROBOT_MASS
from rl_cbf_clf_controller.planar_robot import PinnedRobot, Structure
from rl_cbf_clf_controller.robot_numbers import read_robot

H = 1e-6
WALKER = Path(__file__).resolve().parents[4] / "examples" / "three_link_walker.urdf"
peer = pytest.importorskip("rabbit_gait_design.pinocchio_model", reason="no studies")


def leg_tip(q, hip, knee):
    """Foot position from trigonometry, metres."""
    thigh, shin = q[2] + q[hip], q[2] + q[hip] + q[knee]
    return q[:2] - 0.4 * np.array([np.sin(thigh) + np.sin(shin), np.cos(thigh) + np.cos(shin)])


PIN = peer.PinocchioModel().model


class SymbolicModel:
    """`planar_robot.py` with the methods of `PinocchioModel`."""

    def __init__(self, urdf=None, motor_gain=1.0, joint_damping=0.0):
        read = read_robot(urdf)
        self.numbers = replace(read, motor_gain=motor_gain * read.motor_gain, joint_damping=joint_damping)
        robot = PinnedRobot(read.structure)
        swing_rate = robot.rate(robot.swing)
        inputs = {"q": robot.q, "dq": robot.dq, "robot": packed(robot.parameters)}
        found = {"swing": robot.swing, "swing_rate": swing_rate, "jacobian": ca.jacobian(robot.swing, robot.q)}
        found |= {"bias": robot.rate(swing_rate), "hip": robot.hip, "hip_rate": robot.rate(robot.hip)}
        found |= {"acceleration_a": robot.acceleration.a, "acceleration_b": robot.acceleration.b}
        found |= {"force_a": robot.force.a, "force_b": robot.force.b, "mass": robot.mass_and_bias[0]}
        self._function = NumpyFunction.of("model", inputs, found)

    def update(self, q_s, dq_s):
        self._at = found = self._function(q_s, dq_s, self.numbers.row)
        return peer.Kinematics(found.swing, found.swing_rate, found.jacobian, found.bias, found.hip, found.hip_rate)

    def pinned(self):
        found = self._at
        acceleration, force = (found.acceleration_a, found.acceleration_b), (found.force_a, found.force_b)
        return peer.PinnedDynamics(Affine(*acceleration), Affine(*force))

    def mass_matrix(self):
        return self._at.mass


MODELS = SymbolicModel, peer.PinocchioModel
EITHER = pytest.mark.parametrize("make_model", MODELS)


def test_mass_is_the_papers():
    assert pin.computeTotalMass(PIN) == pytest.approx(ROBOT_MASS)
    assert read_robot().links[:, 0].sum() == pytest.approx(ROBOT_MASS)


@EITHER
def test_feet_follow_trigonometry_and_their_jacobian_and_bias_are_differences(state, make_model):
    q, dq = state
    model = make_model()
    feet = model.update(q, dq)
    assert feet.swing == pytest.approx(leg_tip(q, 5, 6) - leg_tip(q, 3, 4), abs=1e-12)
    assert feet.hip == pytest.approx(q[:2] - leg_tip(q, 3, 4), abs=1e-12)
    columns = [(model.update(q + H * e, dq).swing - model.update(q - H * e, dq).swing) / (2 * H) for e in np.eye(7)]
    assert feet.swing_jacobian == pytest.approx(np.array(columns).T, abs=1e-8)
    ahead, behind = model.update(q + H * dq, dq), model.update(q - H * dq, dq)
    assert feet.swing_bias == pytest.approx((ahead.swing_rate - behind.swing_rate) / (2 * H), abs=1e-6)


@EITHER
def test_stance_foot_does_not_accelerate_and_newton_holds(state, make_model):
    q, dq = state
    model = make_model()
    model.update(q, dq)
    dynamics, u = model.pinned(), np.array([10.0, -20.0, 5.0, 30.0])
    acceleration, force = dynamics.acceleration(u), dynamics.force(u)
    step = [leg_tip(q + s * 1e-4 * dq + 0.5 * (s * 1e-4) ** 2 * acceleration, 3, 4) for s in (-1, 0, 1)]
    assert (step[0] - 2 * step[1] + step[2]) / 1e-8 == pytest.approx(0, abs=1e-4)
    jacobian = np.array([(leg_tip(q + H * e, 3, 4) - leg_tip(q - H * e, 3, 4)) / (2 * H) for e in np.eye(7)]).T
    data = PIN.createData()
    left = pin.rnea(PIN, data, q, dq, acceleration)
    assert left == pytest.approx(peer.input_map(7) @ u + jacobian.T @ force, abs=1e-5)
    pin.centerOfMass(PIN, data, q, dq, acceleration)
    assert force == pytest.approx(ROBOT_MASS * (data.acom[0] - PIN.gravity.linear)[[0, 2]], abs=1e-9)


@EITHER
def test_power_of_torque_is_the_rate_of_energy(state, make_model):
    q, dq = state
    model = make_model()
    model.update(q, dq)
    jacobian = np.array([(leg_tip(q + H * e, 3, 4) - leg_tip(q - H * e, 3, 4)) / (2 * H) for e in np.eye(7)]).T
    dq = dq - np.linalg.pinv(jacobian) @ jacobian @ dq  # the stance foot rests
    model.update(q, dq)
    u = np.array([10.0, -4.0, 7.0, 3.0])
    acceleration = model.pinned().acceleration(u)
    data = PIN.createData()

    def energy(t):
        return pin.computeMechanicalEnergy(PIN, data, q + t * dq + t**2 / 2 * acceleration, dq + t * acceleration)

    assert (energy(1e-5) - energy(-1e-5)) / 2e-5 == pytest.approx(u @ dq[3:], rel=1e-5)


def test_impact_stops_the_new_stance_foot_and_loses_energy(state):
    q, dq = state
    model = peer.PinocchioModel()
    after, impulse = model.impact(q, dq)
    jacobian = np.array([(leg_tip(q + H * e, 5, 6) - leg_tip(q - H * e, 5, 6)) / (2 * H) for e in np.eye(7)]).T
    mass = model.mass_matrix()
    assert jacobian @ after == pytest.approx(0, abs=1e-7)
    assert mass @ (after - dq) == pytest.approx(jacobian.T @ impulse, abs=1e-6)
    assert after @ mass @ after <= dq @ mass @ dq


@pytest.mark.parametrize("seed", range(20))
def test_both_models_agree(seed):
    """Of robots with unlike legs, weak motors and damped joints, on level ground."""
    rng = np.random.default_rng(seed)
    urdf = re.sub(
        r'(mass value|iyy)="([^"]+)"',
        lambda found: f'{found[1]}="{float(found[2]) * rng.uniform(0.7, 1.5)!r}"',
        URDF_PATH.read_text(),
    )
    q, dq, u = rng.normal(0, 0.5, 7), rng.normal(0, 2, 7), rng.normal(0, 50, 4)
    own, peer = (kind(urdf, motor_gain=0.8, joint_damping=0.4) for kind in MODELS)
    for ours, theirs in zip(vars(own.update(q, dq)).values(), vars(peer.update(q, dq)).values(), strict=True):
        assert ours == pytest.approx(theirs, rel=1e-10, abs=1e-10)
    assert own.mass_matrix() == pytest.approx(peer.mass_matrix(), abs=1e-12)
    for name in ("acceleration", "force"):
        assert getattr(own.pinned(), name)(u) == pytest.approx(getattr(peer.pinned(), name)(u), rel=1e-9, abs=1e-9)


@pytest.mark.skipif(not WALKER.is_file(), reason="the package is not in the project")
def test_another_planar_robot_is_read_from_its_urdf():
    """A torso with two straight legs."""
    text = with_planar_base(WALKER.read_text())
    assert read_robot(text).structure == Structure(parents=(0, 0), feet=(1, 2))
    rng, (own, peer) = np.random.default_rng(0), (kind(text) for kind in MODELS)
    q, dq, u = rng.normal(0, 0.5, 5), rng.normal(0, 2, 5), rng.normal(0, 50, 2)
    own.update(q, dq)
    peer.update(q, dq)
    assert own.pinned().acceleration(u) == pytest.approx(peer.pinned().acceleration(u), rel=1e-9)
    assert own.pinned().force(u) == pytest.approx(peer.pinned().force(u), rel=1e-9)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (URDF_PATH.read_text().replace('<axis xyz="0 1 0"/>', '<axis xyz="1 0 0"/>', 1), "then turns about y"),
        (URDF_PATH.read_text().replace("right_foot", "right_toe"), "no link right_foot"),
    ],
)
def test_a_robot_that_is_not_planar_or_has_no_such_feet_is_refused(text, message):
    with pytest.raises(ValueError, match=message):
        read_robot(text)
