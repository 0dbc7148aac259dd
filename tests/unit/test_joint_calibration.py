"""Offsets of the joints' angles, found from a foot that stands."""

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp.functions import NumpyFunction
from rabbit_gait_design.pinocchio_model import PinocchioModel
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.robot_urdf import perturbed_urdf
from rl_cbf_clf_controller.joint_calibration import OFFSETS, UNKNOWN, calibrated
from rl_cbf_clf_controller.robot_numbers import read_robot

POSE = np.array([0.0, 0.75, 0.1, -0.3, 0.5, -0.3, 0.6])


def random_state(rng):
    return POSE + rng.uniform(-0.3, 0.3, 7), rng.uniform(-3, 3, 7)


@pytest.mark.parametrize("bend", [0.05, -0.05, 0.0])
def test_a_bent_leg_is_a_turned_hip(bend):
    """To first order in the bend: what is left is below its square times the leg's length."""
    q, dq = random_state(np.random.default_rng(1))
    true = PinocchioModel(perturbed_urdf(SimulationParameters(link_bend=bend))).update(q, dq)
    nominal = PinocchioModel().update(q - OFFSETS @ np.array([bend, 0.0]), dq)
    assert nominal.hip == pytest.approx(true.hip, abs=0.8 * bend**2 + 1e-12)
    assert nominal.swing == pytest.approx(true.swing, abs=1.6 * bend**2 + 1e-12)


@pytest.mark.parametrize("offset", [0.05, -0.03, 0.0])
def test_the_offset_is_found_while_the_foot_stands(offset):
    model, rng = PinocchioModel(), np.random.default_rng(2)
    shapes = {"offsets": (2, 1), "offset_covariance": (2, 2), "x": (14, 1), "joints": (4, 2), "feet": (2, 2)}
    s = {name: ca.SX.sym(name, *shape) for name, shape in shapes.items()}
    step, robot = NumpyFunction.of("calibrated", s, calibrated(s, s["x"], s["joints"], s["feet"])), read_robot()
    offsets, found, covariance = np.array([offset, 0.0]), *UNKNOWN.values()
    for _ in range(200):
        q, dq = random_state(rng)
        feet = model.update(q, dq)
        dq[:2] = feet.hip_rate  # so that the true foot stands
        x = np.concatenate([q + OFFSETS @ (offsets - found), dq])
        after = step(found, covariance, x, robot.joints, robot.feet)
        found, covariance = after.offsets, after.offset_covariance
    assert found == pytest.approx(offsets, abs=1e-3)
