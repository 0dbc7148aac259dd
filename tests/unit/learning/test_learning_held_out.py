"""The measure of a policy on held-out transitions."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from rl_cbf_clf_controller.context import PolicyContext
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.uncertainty import Estimates, Problem
from rl_trainer.held_out import estimation_error
from rl_trainer.parameters import TrainingParameters
from rl_trainer.transitions import Doubt, Transition


class Informed:
    """Knows a share of the truth."""

    version = "informed"

    def __init__(self, problem: Problem, truth: Any, share: float) -> None:
        self._problem, self._truth, self._share = problem, truth, share

    def estimate(self, context: PolicyContext) -> Estimates:
        alpha, beta = self._truth(self._problem, context.observation, context.LgV)
        return Estimates(self._share * alpha, self._share * beta)


@pytest.mark.parametrize("problem", Problem)
def test_error_is_the_share_that_is_not_known(
    problem: Problem, random_transition: Callable[..., Transition], truth: Any
) -> None:
    rng, parameters = np.random.default_rng(0), TrainingParameters(problem=problem)
    transitions = [random_transition(problem, rng) for _ in range(20)]
    transitions.append(random_transition(problem, rng, doubt=Doubt.UNMEASURED, measured=np.full(parameters.n, np.nan)))
    for share in (0.0, 0.7, 1.0):
        policy = Informed(problem, truth, share)
        np.testing.assert_allclose(estimation_error(policy, transitions, parameters), 1 - share, atol=1e-9)
    np.testing.assert_allclose(estimation_error(ZeroPolicy(problem), transitions, parameters), 1)
    assert np.isnan(estimation_error(ZeroPolicy(problem), transitions[-1:], parameters)).all()
