"""The learners find errors that are known in closed form, from measured transitions alone; from a policy on."""

import copy
from typing import Any

import numpy as np
import pytest
import torch
from rabbit_description.plugins import PluginError
from rl_cbf_clf_controller.policy import ActorPolicy
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.uncertainty import IO_RL_CLF_QP, PAPER, RL_CBF_CLF_QP, RL_CLF_QP
from rl_cbf_clf_controller.weights import PROBE, PolicyFile
from rl_trainer import training
from rl_trainer.ddpg import Ddpg
from rl_trainer.learner import Learner
from rl_trainer.paper_ddpg import PaperDdpg
from rl_trainer.parameters import PAPER_LITERAL, TrainingParameters
from rl_trainer.replay import Batch, as_batch
from rl_trainer.training import Trainer, make_learner
from tiny_world import random_transition, true_errors

SMALL = {"hidden1": 96, "hidden2": 64, "batch": 128, "actor_rate": 2e-3, "critic_rate": 2e-3, "polyak": 5e-3}
DDPG, REGRESSION = {"learner": "ddpg"}, {"learner": "regression"}


@pytest.mark.parametrize(
    ("problem", "changes", "updates"),
    [
        (RL_CBF_CLF_QP, DDPG, 2500),
        (RL_CBF_CLF_QP, REGRESSION, 2500),
        (RL_CLF_QP, DDPG, 1500),
        (IO_RL_CLF_QP, DDPG, 2500),
        (IO_RL_CLF_QP, REGRESSION, 2500),
    ],
)
def test_closed_form_errors_are_recovered(problem: Problem, changes: dict[str, Any], updates: int) -> None:
    """At states and mu not trained on, the corrections explain >= 95% of the variance of the true errors."""
    rng, trainer = np.random.default_rng(0), Trainer(TrainingParameters(problem=problem, **SMALL, **changes))
    for _ in range(1500):
        trainer.replay.add(random_transition(problem, rng))
    trainer.learn(updates)
    policy, rng = ActorPolicy(trainer.policy_file()), np.random.default_rng(1)
    wrong, size = [], []
    for _ in range(300):
        fresh = random_transition(problem, rng)
        estimates = policy.act(fresh.observation, fresh.LgV)
        alpha, beta = true_errors(problem, fresh.observation, fresh.LgV)
        wrong.append(estimates.error(fresh.mu) - (alpha @ fresh.mu + beta))
        size.append(alpha @ fresh.mu + beta)
    share = np.square(wrong).mean(axis=0) / np.square(size).mean(axis=0)
    assert share.max() < 0.05, share


@pytest.mark.parametrize("kind", [Ddpg, PaperDdpg])
def test_an_update_is_the_one_that_the_equations_say(
    kind: type[Ddpg | PaperDdpg], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Both losses, by numpy from the weights; the noise of sampled actions and probes is zero."""
    monkeypatch.setattr(Ddpg, "_noise", lambda _, like: torch.zeros_like(like))
    literal = PAPER_LITERAL if kind is PaperDdpg else {}
    parameters = TrainingParameters(problem=RL_CBF_CLF_QP, hidden1=6, hidden2=5, **literal)
    torch.manual_seed(4)
    learner, rng, n = kind(parameters), np.random.default_rng(3), 5
    batch = as_batch([random_transition(RL_CBF_CLF_QP, rng, failed=k == 2) for k in range(4)], parameters)
    values = {name: value.double().numpy() for name, value in vars(batch).items()}
    actor = copy.deepcopy(learner.acting)
    before = copy.deepcopy(learner._critic)
    losses = learner.update(batch, 1.0)
    center, scale = np.array([RL_CBF_CLF_QP.unit(name) for name in RL_CBF_CLF_QP.observation]).T
    scaled = (values["observation"] - center) / scale
    alpha, beta = (value.detach().double().numpy() for value in actor(batch.observation, batch.LgV))
    if kind is PaperDdpg:
        size = np.ones((4, n))
        size[:, 0] += np.linalg.norm(values["LgV"], axis=1)
        alpha_unit, beta_unit = (np.array(scale) * size for scale in parameters.scales[:2])

        def flat(alpha: Any, beta: Any) -> Any:
            return np.hstack([(alpha / alpha_unit[..., None]).reshape(4, -1), beta / beta_unit])

        next_scaled = (values["next_observation"] - center) / scale
        next_action = flat(*(part.detach().double().numpy() for part in actor(batch.next_observation, batch.next_LgV)))
        reward = values["reward"].sum(1) + values["penalty"]
        wanted = reward + 0.99 * (1 - values["failed"]) * network(before, next_scaled, next_action)[:, 0]
        q = network(before, scaled, flat(values["alpha"], values["beta"]))[:, 0]
        assert losses["critic"] == pytest.approx(np.mean((q - wanted) ** 2), rel=1e-4)
        q = network(learner._critic, scaled, flat(alpha, beta))[:, 0]
        assert losses["actor"] == pytest.approx(-q.mean(), rel=1e-4)
        return
    out = network(before, scaled, values["mu_qp"] / RL_CBF_CLF_QP.mu_unit)
    direction = values["LgV"] / (np.linalg.norm(values["LgV"], axis=1, keepdims=True) + 1)
    matrix, others, offset = out[:, :16].reshape(4, 4, 4), out[:, 16:32].reshape(4, 4, 4), out[:, 32:]
    slope = np.concatenate([np.einsum("bi,bij->bj", direction, matrix)[:, None], others], 1)

    def q_of(mu: Any) -> Any:
        t = offset + np.einsum("bnj,bj->bn", slope, (mu - values["mu_qp"]) / (0.2 * RL_CBF_CLF_QP.mu_unit))
        return -(((np.einsum("bnj,bj->bn", alpha, mu) + beta) / values["unit"] - t) ** 2)

    estimate = np.einsum("bnj,bj->bn", alpha, values["mu"]) + beta
    wrong = np.abs(q_of(values["mu"]) + (estimate / values["unit"] - values["target"]) ** 2)
    huber = np.where(wrong < 1, wrong**2 / 2, wrong - 0.5)
    assert losses["critic"] == pytest.approx(huber.mean(), rel=1e-4)
    assert losses["actor"] == pytest.approx(-q_of(values["mu_qp"]).sum(1).mean(), rel=1e-4)


def network(critic: torch.nn.Module, *inputs: Any) -> Any:
    """A critic's network, by numpy."""
    values = np.hstack(inputs)
    *hidden, last = [layer for layer in critic.network if isinstance(layer, torch.nn.Linear)]
    for layer in hidden:
        values = np.maximum(values @ layer.weight.detach().double().numpy().T + layer.bias.detach().numpy(), 0)
    return values @ last.weight.detach().double().numpy().T + last.bias.detach().numpy()


TINY = {"hidden1": 12, "hidden2": 9}


def policy(parameters: TrainingParameters) -> PolicyFile:
    """Random weights."""
    trainer = Trainer(parameters)
    torch.manual_seed(3)
    for weight in trainer.learner.acting.parameters():
        torch.nn.init.normal_(weight, std=0.3)
    return trainer.policy_file()


@pytest.mark.parametrize("problem", PAPER)
@pytest.mark.parametrize("learner", ["ddpg", "paper_ddpg", "regression"])
def test_it_begins_with_the_policys_weights(problem: Problem, learner: str) -> None:
    parameters = TrainingParameters(problem=problem, learner=learner, **TINY)
    given, trainer = policy(parameters), Trainer(parameters)
    trainer.start_from(given)
    mine = trainer.policy_file()
    for name, array in given.arrays.items():
        np.testing.assert_allclose(mine.arrays[name], array, atol=1e-6 if name == PROBE else 0)


def test_the_policy_stays_until_the_critic_has_learned(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(training, "CRITIC_FIRST", 6)
    parameters, rng = TrainingParameters(batch=8, **TINY), np.random.default_rng(0)
    given, trainer = policy(parameters), Trainer(parameters)
    trainer.start_from(given)
    for _ in range(20):
        trainer.replay.add(random_transition(parameters.problem, rng))
    same = []
    for _ in range(9):
        trainer.learn(1)
        same.append(np.array_equal(trainer.policy_file().arrays["0.weight"], given.arrays["0.weight"]))
    assert same == [True] * 6 + [False] * 3


class WithoutActor(Learner):
    def __init__(self, parameters: TrainingParameters) -> None:
        pass

    def update(self, batch: Batch, rate: float) -> dict[str, float]:
        return {}


@pytest.mark.parametrize(
    ("kind", "said"), [(repr, "expected a `Learner`"), (Learner, "with an `update`"), (WithoutActor, "`acting`")]
)
def test_what_is_no_learner_is_refused_by_name(kind: Any, said: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rl_trainer.training.load", lambda group, name: kind)
    with pytest.raises(PluginError, match=f"rabbit.learners ddpg: .*{said}"):
        make_learner(TrainingParameters())
