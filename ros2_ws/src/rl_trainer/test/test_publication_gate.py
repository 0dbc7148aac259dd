"""The measure of a policy on held-out transitions, and the gate that goes by it."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from cbf_clf_qp.estimates import Estimates
from rabbit_description.state import Array
from rl_cbf_clf_controller.policy import LearnedPolicy, ZeroPolicy
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.uncertainty import PAPER, RL_CBF_CLF_QP
from rl_trainer.parameters import TrainingParameters
from rl_trainer.publication_gate import EVERY, NEWEST, PublicationGate, estimation_error
from rl_trainer.transitions import Doubt, Transition


class Informed(LearnedPolicy):
    """Knows a share of the truth."""

    version = "informed"

    def __init__(self, problem: Problem, truth: Any, share: float) -> None:
        self._problem, self._truth, self._share = problem, truth, share

    def act(self, observation: Array, LgV: Array) -> Estimates:
        alpha, beta = self._truth(self._problem, observation, LgV)
        return Estimates(self._share * alpha, self._share * beta)


@pytest.mark.parametrize("problem", PAPER)
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


def walked(make: Callable[..., Transition], steps: int, ticks: int, **changes: Any) -> list[Transition]:
    """The transitions of an episode."""
    rng = np.random.default_rng(1)
    return [
        make(RL_CBF_CLF_QP, rng, step_index=step, tick=step * ticks + tick, **changes)
        for step in range(steps)
        for tick in range(ticks)
    ]


def test_one_step_in_five_is_held_out_across_episodes(random_transition: Callable[..., Transition]) -> None:
    gate, steps = PublicationGate(TrainingParameters()), 7
    held = [[gate.holds_out(t) for t in walked(random_transition, steps, 3)][::3] for _ in range(5)]
    assert np.flatnonzero(held).tolist() == list(range(EVERY - 1, 5 * steps, EVERY))
    assert not any(gate.holds_out(t) for t in walked(random_transition, 10, 3, doubt=Doubt.SETTLING))


def test_the_gate_lets_pass_what_is_no_worse(random_transition: Callable[..., Transition], truth: Any) -> None:
    problem = RL_CBF_CLF_QP
    gate, informed = (
        PublicationGate(TrainingParameters()),
        [Informed(problem, truth, share) for share in (-0.1, 0.0, 0.7, 0.8)],
    )
    assert gate.judge(informed[0]) is None
    for transition in walked(random_transition, 2 * EVERY, NEWEST // 2):
        gate.holds_out(transition)
    verdicts = [gate.judge(policy) for policy in informed]
    assert [verdict.passes for verdict in verdicts if verdict] == [False, True, True, True]
    gate.in_force = informed[2]
    verdict = gate.judge(informed[1])
    assert verdict is not None
    assert (verdict.passes, verdict.ticks) == (False, NEWEST)
    np.testing.assert_allclose((verdict.error, verdict.error_in_force), (1.0, 0.3))
    better = gate.judge(informed[3])
    assert better is not None
    assert better.passes
