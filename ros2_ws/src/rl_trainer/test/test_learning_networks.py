"""Actor against its numpy twin, critics against the reward's form."""

import copy
from collections.abc import Callable

import numpy as np
import pytest
import torch
from rl_cbf_clf_controller.policy import ActorPolicy
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.uncertainty import PAPER
from rl_cbf_clf_controller.weights import decode
from rl_trainer.actor import Actor
from rl_trainer.critic import Action, AffineCritic, PlainCritic, RewardCritic
from rl_trainer.learner import ClippedAdam
from rl_trainer.parameters import TrainingParameters
from rl_trainer.replay import as_batch
from rl_trainer.training import Trainer
from rl_trainer.transitions import Transition

MakeTransition = Callable[..., Transition]


@pytest.mark.parametrize("problem", PAPER)
@pytest.mark.parametrize("structured", [True, False])
@pytest.mark.parametrize("shared", [True, False])
@pytest.mark.parametrize("observe_l_min", [True, False])
def test_actor_and_its_numpy_twin(problem: Problem, structured: bool, shared: bool, observe_l_min: bool) -> None:
    parameters = TrainingParameters(
        problem=problem, structured=structured, shared=shared, observe_l_min=observe_l_min, hidden1=12, hidden2=9
    )
    trainer = Trainer(parameters)
    for weight in trainer.learner.acting.parameters():
        torch.nn.init.normal_(weight, std=0.3)
    policy = ActorPolicy(decode(trainer.policy_file().encode(), problem))
    rng = np.random.default_rng(0)
    for _ in range(5):
        observation, LgV = 0.3 * rng.standard_normal(len(problem.observation)), 5 * rng.standard_normal(4)
        estimates = policy.act(observation, LgV)
        inputs = torch.tensor(observation[: len(parameters.observation)][None], dtype=torch.float32)
        with torch.no_grad():
            alpha, beta = trainer.learner.acting(inputs, torch.tensor(LgV[None], dtype=torch.float32))
        np.testing.assert_allclose(estimates.alpha, alpha[0], rtol=1e-3, atol=1e-3)
        np.testing.assert_allclose(estimates.beta, beta[0], rtol=1e-3, atol=1e-2)


def test_separate_networks_do_not_share_a_weight() -> None:
    """The gradient of one quantity reaches one network only (Remark 1)."""
    actor = Actor(TrainingParameters(shared=False, hidden1=6, hidden2=5))
    alpha, _ = actor(torch.randn(3, 15), torch.randn(3, 4))
    alpha[:, 2].sum().backward()
    touched = [any(p.grad is not None and p.grad.any() for p in net.parameters()) for net in actor.networks]
    assert touched == [False, False, True, False, False]


def test_untrained_actor_is_nearly_the_zero_policy() -> None:
    actor = Actor(TrainingParameters())
    observation = actor.scaling.center + actor.scaling.scale * torch.randn(50, 15)
    LgV = torch.randn(50, 4)
    assert actor.unit_action(observation, LgV, actor.clf_size(LgV)).abs().max() < 0.02


@pytest.mark.parametrize("form", [RewardCritic, AffineCritic])
@pytest.mark.parametrize("norm", ["squared", "absolute"])
def test_reward_critic_peaks_at_its_target(
    norm: str, form: type[RewardCritic], random_transition: MakeTransition
) -> None:
    parameters = TrainingParameters(error_norm=norm)  # type: ignore[arg-type]
    rng = np.random.default_rng(1)
    batch = as_batch([random_transition(parameters.problem, rng) for _ in range(6)], parameters)
    critic = form(parameters)
    seen = critic.see(batch)
    best = critic.target(batch, seen, batch.mu, torch.empty(0)) * batch.unit
    action = Action(torch.zeros(6, 5, 4), best, torch.empty(0))
    assert critic(batch, seen, batch.mu, action).abs().max() < 1e-6
    off = Action(torch.zeros(6, 5, 4), best + 2 * batch.unit, torch.empty(0))
    expected = -4.0 if norm == "squared" else -2.0
    assert torch.allclose(critic(batch, seen, batch.mu, off), torch.tensor(expected), rtol=1e-3)


def test_affine_critic_is_affine_in_mu(random_transition: MakeTransition) -> None:
    parameters, rng = TrainingParameters(), np.random.default_rng(3)
    batch = as_batch([random_transition(parameters.problem, rng) for _ in range(6)], parameters)
    critic, step = AffineCritic(parameters), 50 * torch.randn(6, 4)
    seen = critic.see(batch)
    here, there, between = (critic.target(batch, seen, batch.mu + k * step, torch.empty(0)) for k in (0, 1, 0.5))
    assert torch.allclose(between, (here + there) / 2, atol=1e-4)
    assert not torch.allclose(here, there, atol=1e-3)


@pytest.mark.parametrize("structured", [True, False])
@pytest.mark.parametrize("shared", [True, False])
def test_full_decay_leaves_alphas_that_do_not_vary(structured: bool, shared: bool) -> None:
    """All of the share taken off: every alpha over |LgV| is the same at every state, and the betas are as they were."""
    actor = Actor(TrainingParameters(structured=structured, shared=shared))
    with torch.no_grad():
        for parameter in actor.parameters():
            parameter.add_(0.05 * torch.randn_like(parameter))
    observation = actor.scaling.center + actor.scaling.scale * torch.randn(20, 15)
    LgV = torch.ones(20, 4)
    alpha, beta = actor(observation, LgV)
    actor.steady_alphas(1.0)
    steady, same = actor(observation, LgV)
    assert alpha.std(0).max() > 1e-3
    assert steady.std(0).max() < 1e-5
    assert torch.equal(beta, same)


@pytest.mark.parametrize(("heads", "outputs"), [("one", 1), ("each", 5)])
@pytest.mark.parametrize("sees_mu", [True, False])
def test_plain_critic_sees_what_it_should(
    heads: str, outputs: int, sees_mu: bool, random_transition: MakeTransition
) -> None:
    parameters = TrainingParameters(critic="plain", heads=heads, critic_sees_mu=sees_mu)  # type: ignore[arg-type]
    rng = np.random.default_rng(2)
    batch = as_batch([random_transition(parameters.problem, rng) for _ in range(4)], parameters)
    action = Action(batch.alpha, batch.beta, torch.randn(4, 25))
    critic = PlainCritic(parameters)
    seen = critic.see(batch)
    q = critic(batch, seen, batch.mu, action)
    assert q.shape == (4, outputs)
    assert torch.equal(q, critic(batch, seen, batch.mu + 10, action)) != sees_mu


def test_our_adam_is_torchs_with_a_clipped_gradient() -> None:
    """Bit for bit, also after a checkpoint."""
    torch.manual_seed(3)
    ours = torch.nn.Sequential(torch.nn.Linear(7, 20), torch.nn.ReLU(), torch.nn.Linear(20, 3))
    theirs = copy.deepcopy(ours)
    adam, reference = ClippedAdam(ours, 3e-3, 0.5), torch.optim.Adam(theirs.parameters(), lr=3e-3, fused=True)
    for step in range(20):
        inputs = 3 * torch.randn(16, 7)
        adam.descend(ours(inputs).square().mean(), rate=0.9**step)
        reference.param_groups[0]["lr"] = 3e-3 * 0.9**step
        reference.zero_grad()
        theirs(inputs).square().mean().backward()
        torch.nn.utils.clip_grad_norm_(theirs.parameters(), 0.5)
        reference.step()
        if step == 10:
            state, adam = adam.state_dict(), ClippedAdam(ours, 3e-3, 0.5)
            adam.load_state_dict(state)
    assert all(torch.equal(a, b) for a, b in zip(ours.parameters(), theirs.parameters(), strict=True))
