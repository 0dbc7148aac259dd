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


def found_after(steps, offsets, foot_velocity):
    """What is known after so many random states of a robot with these offsets, whose foot moves so at step k."""
    model, rng = PinocchioModel(), np.random.default_rng(2)
    shapes = {name: (*np.shape(value), 1)[:2] for name, value in UNKNOWN.items()}
    shapes |= {"x": (14, 1), "ticks": (1, 1), "noise": (1, 1), "joints": (4, 2), "feet": (2, 2)}
    s = {name: ca.SX.sym(name, *shape) for name, shape in shapes.items()}
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
