"""The predicted state against the equations of motion, integrated finely."""

import numpy as np
import pytest
from rabbit_description.gait import DEFAULT_GAIT, load_gaits
from rabbit_description.state import TICK_SECONDS
from rl_cbf_clf_controller.generated_model import make_model
from rl_cbf_clf_controller.state_prediction import MOST, predicted_state

TORQUE = np.array([20.0, -15.0, 10.0, -5.0])


def integrated(robot, q, dq, seconds, steps=200):
    """By the midpoint rule, error (seconds / steps)^2."""
    h = seconds / steps
    for _ in range(steps):
        middle = robot.robot_at(q, dq).at(q, dq)[1].acceleration(TORQUE)
        q_m, dq_m = q + h / 2 * dq, dq + h / 2 * middle
        q, dq = q + h * dq_m, dq + h * robot.robot_at(q_m, dq_m).at(q_m, dq_m)[1].acceleration(TORQUE)
    return q, dq


@pytest.mark.parametrize("lag", [0.1, 0.4, 1.0])
def test_the_error_is_of_third_order_in_q_and_second_in_dq(lag):
    robot, start = make_model(None), load_gaits(DEFAULT_GAIT).x_start
    q, dq = predicted_state(robot.robot_at(*start), *start, TORQUE, lag)
    seconds = lag * TICK_SECONDS
    exact_q, exact_dq = integrated(robot, *start, seconds)
    jerk = (
        np.abs(
            robot.robot_at(exact_q, exact_dq).at(exact_q, exact_dq)[1].acceleration(TORQUE)
            - robot.robot_at(*start).at(*start)[1].acceleration(TORQUE)
        ).max()
        / seconds
    )
    assert np.abs(q - exact_q).max() <= 1.1 * jerk * seconds**3 / 6 + 1e-9
    assert np.abs(dq - exact_dq).max() <= 1.1 * jerk * seconds**2 / 2 + 1e-9


@pytest.mark.parametrize("lag", [0.0, -0.3])
def test_without_delay_the_state_is_that_of_now(lag):
    robot, start = make_model(None), load_gaits(DEFAULT_GAIT).x_start
    q, dq = predicted_state(robot.robot_at(*start), *start, TORQUE, lag)
    assert np.array_equal(q, start[0])
    assert np.array_equal(dq, start[1])


def test_it_looks_so_far_ahead_at_most():
    robot, start = make_model(None), load_gaits(DEFAULT_GAIT).x_start
    far = predicted_state(robot.robot_at(*start), *start, TORQUE, 50.0)
    most = predicted_state(robot.robot_at(*start), *start, TORQUE, MOST / TICK_SECONDS)
    assert np.array_equal(far, most)
