"""Outputs against closed forms and differences; the predicted state against the motion, integrated finely."""

import numpy as np
import pytest
from rabbit_description import DEFAULT_GAIT
from rabbit_description.gait import load_gait, load_gaits
from rabbit_description.state import TICK_SECONDS
from rl_cbf_clf_controller.robot_numbers import read_robot
from rl_cbf_clf_controller.state_prediction import MOST, prediction_function
from rl_cbf_clf_controller.virtual_constraints import FADING
from scipy.interpolate import BPoly

VirtualConstraints = pytest.importorskip("rabbit_gait_design.path_outputs", reason="no studies").VirtualConstraints
GAIT = load_gait("authors_035")
H = 1e-6


@pytest.mark.parametrize("s", [0.0, 0.2, 0.77, 1.0])
def test_bezier_agrees_with_scipy(s):
    reference = BPoly(GAIT.coeffs.T[:, None, :], [0, 1])
    value, first, second = VirtualConstraints(GAIT).desired(s)
    assert value == pytest.approx(reference(s))
    assert first == pytest.approx(reference(s, nu=1))
    assert second == pytest.approx(reference(s, nu=2))


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


TORQUE = np.array([20.0, -15.0, 10.0, -5.0])
START = np.concatenate(load_gaits(DEFAULT_GAIT).x_start)


def predicted(lag):
    """The state (14,) that is predicted from `START`."""
    return prediction_function()(START, read_robot().row, TORQUE, np.array([lag])).x


@pytest.mark.parametrize("lag", [0.1, 0.4, 1.0])
def test_the_error_is_of_third_order_in_q_and_second_in_dq(lag):
    """Against the midpoint rule by pinocchio, whose error is that of a step 200 times as short."""
    model = pytest.importorskip("rabbit_gait_design.pinocchio_model", reason="no studies").PinocchioModel()

    def acceleration(x):
        model.update(x[:7], x[7:])
        return model.pinned().acceleration(TORQUE)

    seconds, steps, exact = lag * TICK_SECONDS, 200, START
    h = seconds / steps
    for _ in range(steps):
        middle = exact + h / 2 * np.concatenate([exact[7:], acceleration(exact)])
        exact = exact + h * np.concatenate([middle[7:], acceleration(middle)])
    x = predicted(lag)
    jerk = np.abs(acceleration(exact) - acceleration(START)).max() / seconds
    assert np.abs(x - exact)[:7].max() <= 1.1 * jerk * seconds**3 / 6 + 1e-9
    assert np.abs(x - exact)[7:].max() <= 1.1 * jerk * seconds**2 / 2 + 1e-9


def test_it_looks_ahead_from_now_and_so_far_at_most():
    assert np.array_equal(predicted(0.0), START)
    assert np.array_equal(predicted(-0.3), START)
    assert np.array_equal(predicted(50.0), predicted(MOST / TICK_SECONDS))
