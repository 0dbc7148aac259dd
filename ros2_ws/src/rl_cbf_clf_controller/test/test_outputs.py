"""Desired outputs and the outputs themselves against closed forms and differences."""

import numpy as np
import pytest
from rabbit_description.gait import load_gait
from rl_cbf_clf_controller.virtual_constraints import FADING, VirtualConstraints
from scipy.interpolate import BPoly

GAIT = load_gait("authors_035")
H = 1e-6


@pytest.mark.parametrize("s", [0.0, 0.2, 0.77, 1.0])
def test_bezier_agrees_with_scipy(s):
    reference = BPoly(GAIT.coeffs.T[:, None, :], [0, 1])
    value, first, second = VirtualConstraints(GAIT).desired(s)
    assert value == pytest.approx(reference(s))
    assert first == pytest.approx(reference(s, nu=1))
    assert second == pytest.approx(reference(s, nu=2))


@pytest.mark.parametrize("s", [-0.3, -0.01, 0.0, 1.0, 1.02, 1.4])
def test_bezier_goes_on_smoothly_beyond_its_ends(s):
    """Each derivative is the slope of the one before, also across an end."""
    behind, here, ahead = (VirtualConstraints(GAIT).desired(s + h) for h in (-H, 0, H))
    for order in (0, 1):
        assert here[order + 1] == pytest.approx((ahead[order] - behind[order]) / (2 * H), abs=1e-3)


def test_bezier_becomes_straight_far_beyond_its_ends():
    for end, s in ((0.0, -0.5), (1.0, 1.5)):
        curve = VirtualConstraints(GAIT).desired
        _, first, second = curve(end)
        _, slope, curvature = curve(s)
        assert curvature == pytest.approx(0, abs=1e-3)
        assert slope == pytest.approx(first + np.sign(s) * FADING * second, abs=1e-3)


def test_outputs_vanish_where_the_joints_follow_the_gait():
    constraints = VirtualConstraints(GAIT)
    q = GAIT.x_start[0]
    desired = constraints.desired(constraints.phase(q))[0]
    y = constraints.evaluate(q, np.zeros(7)).y
    assert y == pytest.approx(q[3:] - desired)
    q = np.array([0, 0.75, GAIT.phase_angle_start - desired[0] - desired[1] / 2, *desired])
    assert constraints.evaluate(q, np.zeros(7)).phase == pytest.approx(0, abs=1e-12)


def test_phase_is_0_and_1_at_its_ends():
    constraints = VirtualConstraints(GAIT)
    for angle, phase in ((GAIT.phase_angle_start, 0.0), (GAIT.phase_angle_end, 1.0)):
        q = np.array([0, 0.75, angle + 0.1, -0.3, 0.4, 0, 0])
        assert constraints.evaluate(q, np.zeros(7)).phase == pytest.approx(phase, abs=1e-12)


def test_derivatives_of_outputs_by_differences(state):
    q, dq = state
    constraints, ddq = VirtualConstraints(GAIT), np.array([0.5, -1, 2, 3, -2, 1, 4.0])
    q = q.copy()
    q[2] += GAIT.phase_angle_start + 0.2 - (q[2] + q[3] + q[4] / 2)  # a phase inside (0, 1)
    ahead, behind = (constraints.evaluate(q + t * dq, dq + t * ddq) for t in (H, -H))
    here = constraints.evaluate(q, dq)
    assert here.dy == pytest.approx((ahead.y - behind.y) / (2 * H), abs=1e-6)
    assert here.jacobian @ ddq + here.bias == pytest.approx((ahead.dy - behind.dy) / (2 * H), abs=1e-4)
    assert here.phase_rate == pytest.approx((ahead.phase - behind.phase) / (2 * H), abs=1e-6)
