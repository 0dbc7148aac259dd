"""Reward, replay, parameters."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.uncertainty import PAPER, RL_CBF_CLF_QP, RL_CLF_QP
from rl_trainer.parameters import TrainingParameters
from rl_trainer.replay import Replay
from rl_trainer.reward import reward_terms
from rl_trainer.transitions import Transition

MakeTransition = Callable[..., Transition]


def test_reward_is_the_weighted_sum_of_squares_and_the_penalty(random_transition: MakeTransition) -> None:
    unit = (10.0, 1.0, 1.0, 100.0, 100.0)
    problem = replace(RL_CBF_CLF_QP, name="other", error_scale=unit)
    parameters = TrainingParameters(problem=problem, learner="paper_ddpg", failure_penalty=7)
    transition = random_transition(problem, np.random.default_rng(0), failed=True)
    terms, failure = reward_terms(transition, parameters)
    size = np.array([np.linalg.norm(transition.LgV) + 1, 1, 1, 1, 1])
    estimate = transition.nominal + transition.alpha @ transition.mu + transition.beta
    expected = -(((transition.measured - estimate) / unit / size) ** 2)
    np.testing.assert_allclose(terms, expected)
    assert failure == -7


@pytest.mark.parametrize("problem", PAPER)
def test_true_errors_earn_no_penalty(problem: Problem, random_transition: MakeTransition, truth: Any) -> None:
    transition = random_transition(problem, np.random.default_rng(1))
    alpha, beta = truth(problem, transition.observation, transition.LgV)
    nominal, measured = transition.nominal, transition.measured
    if problem.corrects_input:  # the input is corrected, so the plant answers mu itself
        nominal, measured = transition.mu + alpha @ transition.mu + beta, transition.mu
    transition = replace(transition, alpha=alpha, beta=beta, nominal=nominal, measured=measured)
    terms, _ = reward_terms(transition, TrainingParameters(problem=problem))
    np.testing.assert_allclose(terms, 0, atol=1e-20)


def test_what_is_not_measured_costs_nothing(random_transition: MakeTransition) -> None:
    transition = random_transition(RL_CLF_QP, np.random.default_rng(2), measured=np.array([np.nan]))
    assert reward_terms(transition, TrainingParameters(problem=RL_CLF_QP)) == (0, 0)


def test_replay_drops_the_oldest(random_transition: MakeTransition) -> None:
    parameters = TrainingParameters(capacity=5, batch=64)
    replay, rng = Replay(parameters), np.random.default_rng(3)
    transitions = [random_transition(parameters.problem, rng) for _ in range(8)]
    assert all(replay.add(transition) for transition in transitions)
    kept = {round(float(x), 4) for x in replay.sample().mu[:, 0]}
    assert kept == {round(float(np.float32(t.mu[0])), 4) for t in transitions[3:]}
    assert (len(replay), replay.added) == (5, 8)


@pytest.mark.parametrize(
    "changes",
    [
        {"failure_penalty": 1.0},
        {"alpha_scale": (1.0,)},
        {"beta_scale": (1.0, 1, 1, 1, -1)},
        {"batch": 0},
        {"sigma_factors": ()},
        {"measurement": "none"},
        {"speed": 1},
    ],
)
def test_parameters_that_do_not_fit_are_named(changes: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(changes))):
        TrainingParameters.model_validate(changes)
