"""Reward, replay; the actor in torch against the one in numpy."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from rl_cbf_clf_controller.policy import ActorPolicy
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.uncertainty import PAPER, RL_CBF_CLF_QP, RL_CLF_QP
from rl_cbf_clf_controller.weights import decode
from rl_trainer.parameters import TrainingParameters
from rl_trainer.replay import Replay
from rl_trainer.reward import reward_terms
from rl_trainer.training import Trainer
from tiny_world import random_transition, true_errors


def test_reward_is_the_weighted_sum_of_squares_and_the_penalty() -> None:
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
def test_true_errors_earn_no_penalty(problem: Problem) -> None:
    transition = random_transition(problem, np.random.default_rng(1))
    alpha, beta = true_errors(problem, transition.observation, transition.LgV)
    nominal, measured = transition.nominal, transition.measured
    if problem.corrects_input:  # the input is corrected, so the plant answers mu itself
        nominal, measured = transition.mu + alpha @ transition.mu + beta, transition.mu
    transition = replace(transition, alpha=alpha, beta=beta, nominal=nominal, measured=measured)
    terms, _ = reward_terms(transition, TrainingParameters(problem=problem))
    np.testing.assert_allclose(terms, 0, atol=1e-20)


def test_what_is_not_measured_costs_nothing() -> None:
    transition = random_transition(RL_CLF_QP, np.random.default_rng(2), measured=np.array([np.nan]))
    assert reward_terms(transition, TrainingParameters(problem=RL_CLF_QP)) == (0, 0)


def test_replay_drops_the_oldest() -> None:
    parameters = TrainingParameters(capacity=5, batch=64)
    replay, rng = Replay(parameters), np.random.default_rng(3)
    transitions = [random_transition(parameters.problem, rng) for _ in range(8)]
    assert all(replay.add(transition) for transition in transitions)
    kept = {round(float(x), 4) for x in replay.sample().mu[:, 0]}
    assert kept == {round(float(np.float32(t.mu[0])), 4) for t in transitions[3:]}
    assert (len(replay), replay.added) == (5, 8)


@pytest.mark.parametrize("problem", PAPER)
@pytest.mark.parametrize("structured", [True, False])
@pytest.mark.parametrize("observe_l_min", [True, False])
def test_actor_in_torch_and_in_numpy(problem: Problem, structured: bool, observe_l_min: bool) -> None:
    parameters = TrainingParameters(
        problem=problem, structured=structured, observe_l_min=observe_l_min, hidden1=12, hidden2=9
    )
    trainer = Trainer(parameters)
    for weight in trainer.learner.acting.parameters():
        torch.nn.init.normal_(weight, std=0.3)
    policy = ActorPolicy(decode(trainer.policy_file().encode()))
    rng = np.random.default_rng(0)
    for _ in range(5):
        observation, LgV = 0.3 * rng.standard_normal(len(problem.observation)), 5 * rng.standard_normal(4)
        estimates = policy.act(observation, LgV)
        inputs = torch.tensor(observation[: len(parameters.observation)][None], dtype=torch.float32)
        with torch.no_grad():
            alpha, beta = trainer.learner.acting(inputs, torch.tensor(LgV[None], dtype=torch.float32))
        np.testing.assert_allclose(estimates.alpha, alpha[0], rtol=1e-3, atol=1e-3)
        np.testing.assert_allclose(estimates.beta, beta[0], rtol=1e-3, atol=1e-2)
