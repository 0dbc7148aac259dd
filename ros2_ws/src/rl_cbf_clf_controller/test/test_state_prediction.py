"""The predicted state against the equations of motion, integrated finely."""

import numpy as np
import pytest
from rabbit_description import DEFAULT_GAIT
from rabbit_description.gait import load_gaits
from rabbit_description.state import TICK_SECONDS
from rl_cbf_clf_controller.robot_numbers import read_robot
from rl_cbf_clf_controller.state_prediction import MOST, prediction_function

TORQUE = np.array([20.0, -15.0, 10.0, -5.0])
START = np.concatenate(load_gaits(DEFAULT_GAIT).x_start)


def predicted(lag):
    """The state (14,) that is predicted from `START`."""
    return prediction_function()(START, read_robot().row, TORQUE, np.array([lag])).x


@pytest.fixture
def acceleration(models):
    """q'' (7,) at a state (14,), by pinocchio."""
    model = models[1]()

    def at(x):
        model.update(x[:7], x[7:])
        return model.pinned().acceleration(TORQUE)

    return at


def integrated(acceleration, seconds, steps=200):
    """By the midpoint rule, error (seconds / steps)^2."""
    x, h = START, seconds / steps
    for _ in range(steps):
        middle = x + h / 2 * np.concatenate([x[7:], acceleration(x)])
        x = x + h * np.concatenate([middle[7:], acceleration(middle)])
    return x


@pytest.mark.parametrize("lag", [0.1, 0.4, 1.0])
def test_the_error_is_of_third_order_in_q_and_second_in_dq(acceleration, lag):
    seconds = lag * TICK_SECONDS
    exact, x = integrated(acceleration, seconds), predicted(lag)
    jerk = np.abs(acceleration(exact) - acceleration(START)).max() / seconds
    assert np.abs(x - exact)[:7].max() <= 1.1 * jerk * seconds**3 / 6 + 1e-9
    assert np.abs(x - exact)[7:].max() <= 1.1 * jerk * seconds**2 / 2 + 1e-9


@pytest.mark.parametrize("lag", [0.0, -0.3])
def test_without_delay_the_state_is_that_of_now(lag):
    assert np.array_equal(predicted(lag), START)


def test_it_looks_so_far_ahead_at_most():
    assert np.array_equal(predicted(50.0), predicted(MOST / TICK_SECONDS))
