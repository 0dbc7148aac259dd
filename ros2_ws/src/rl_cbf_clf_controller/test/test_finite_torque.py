"""Torque is finite and within its limit, whatever finite state comes in."""

from functools import cache

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from rabbit_description import DEFAULT_GAIT
from rabbit_description.gait import load_gait
from rabbit_description.state import RobotState, StonePreview
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.scene import ControllerError

GAIT = load_gait(DEFAULT_GAIT)
numbers = st.floats(allow_nan=False, allow_infinity=False)
states = st.tuples(*(arrays(float, n, elements=st.just(0.0) | numbers) for n in (7, 7, 4, 4)))
FAST = tuple(np.zeros(n) if n != 7 else GAIT.x_start[0] for n in (7,)) + (
    np.full(7, 1e154), np.zeros(4), np.zeros(4),
)  # fmt: skip


@cache
def make(objective, sigma):
    """Its limit is 150 N m."""
    parameters = load_parameters("ours", objective=objective, sigma=sigma, torque_limit=150.0)
    return Controller(parameters, GAIT, ZeroPolicy(parameters.problem))


def state_of(numbers, tick=0):
    q, dq, force, applied = numbers
    stone, contact = StonePreview(1, 0.35, 0.40), np.array([True, False])
    return RobotState(tick, q, dq, force.reshape(2, 2), contact, 0, stone, applied=applied)


@pytest.mark.parametrize(("objective", "sigma"), [("paper", 0.0), ("pd_centred", 20.0)])
@settings(max_examples=150, deadline=None, derandomize=True)
@given(states)
@example(FAST)
def test_a_torque_is_finite_and_within_its_limit(objective, sigma, numbers):
    controller = make(objective, sigma)
    controller.reset(0)
    for tick in range(2):
        try:
            acted = controller.act(state_of(numbers, tick))
        except (ControllerError, np.linalg.LinAlgError):
            return  # which ends the episode with its words
        assert np.abs(acted.torque).max() <= 150.0
        assert np.isfinite([*acted.torque, *acted.mu, *acted.mu_qp]).all()


def test_a_joint_that_is_too_fast_ends_the_episode():
    controller = make("paper", 0.0)
    controller.reset(0)
    acted = controller.act(state_of(FAST))
    assert acted.fault.split(":")[0] in ("no solver answered", "torque not finite")
