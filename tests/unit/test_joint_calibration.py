"""Offsets of the joints' angles, found from a foot that stands."""

import numpy as np
import pytest
from rabbit_gait_design.pinocchio_model import PinocchioModel
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.robot_urdf import perturbed_urdf
from rl_cbf_clf_controller.joint_calibration import OFFSETS, JointCalibration
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
    calibration = JointCalibration(read_robot())
    offsets = np.array([offset, 0.0])
    for _ in range(200):
        q, dq = random_state(rng)
        feet = model.update(q, dq)
        dq[:2] = feet.hip_rate  # so that the true foot stands
        calibration.learn(np.concatenate([calibration.corrected(q + OFFSETS @ offsets), dq]))
    assert calibration.value == pytest.approx(offsets, abs=1e-3)
    q = random_state(rng)[0]
    assert calibration.corrected(q + OFFSETS @ offsets) == pytest.approx(q, abs=1e-3)
    calibration.reset()
    np.testing.assert_array_equal(calibration.corrected(q), q)
