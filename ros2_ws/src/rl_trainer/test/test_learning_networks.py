"""The actor in torch against the one in numpy, critics against the reward's form."""

from collections.abc import Callable

import numpy as np
import pytest
import torch
from rl_cbf_clf_controller.policy import ActorPolicy
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.uncertainty import PAPER
from rl_cbf_clf_controller.weights import decode
from rl_trainer.ddpg import AffineCritic, RewardCritic
from rl_trainer.parameters import TrainingParameters
from rl_trainer.replay import as_batch
from rl_trainer.training import Trainer
from rl_trainer.transitions import Transition

MakeTransition = Callable[..., Transition]


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


@pytest.mark.parametrize("form", [RewardCritic, AffineCritic])
def test_reward_critic_peaks_at_its_target(form: type[RewardCritic], random_transition: MakeTransition) -> None:
    parameters, rng = TrainingParameters(), np.random.default_rng(1)
    batch = as_batch([random_transition(parameters.problem, rng) for _ in range(6)], parameters)
    critic, alpha = form(parameters), torch.zeros(6, 5, 4)
    seen = critic.see(batch)
    best = critic.target(batch, seen, batch.mu) * batch.unit
    assert critic(batch, seen, batch.mu, alpha, best).abs().max() < 1e-6
    off = critic(batch, seen, batch.mu, alpha, best + 2 * batch.unit)
    assert torch.allclose(off, torch.tensor(-4.0), rtol=1e-3)


def test_affine_critic_is_affine_in_mu(random_transition: MakeTransition) -> None:
    parameters, rng = TrainingParameters(), np.random.default_rng(3)
    batch = as_batch([random_transition(parameters.problem, rng) for _ in range(6)], parameters)
    critic, step = AffineCritic(parameters), 50 * torch.randn(6, 4)
    seen = critic.see(batch)
    here, there, between = (critic.target(batch, seen, batch.mu + k * step) for k in (0, 1, 0.5))
    assert torch.allclose(between, (here + there) / 2, atol=1e-4)
    assert not torch.allclose(here, there, atol=1e-3)
