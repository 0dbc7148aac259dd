"""The learners find errors that are known in closed form, from measured transitions alone."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from rl_cbf_clf_controller.policy import ActorPolicy
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.uncertainty import IO_RL_CLF_QP, RL_CBF_CLF_QP, RL_CLF_QP
from rl_trainer.ddpg import Ddpg
from rl_trainer.parameters import TrainingParameters, paper_literal
from rl_trainer.replay import as_batch
from rl_trainer.training import Trainer
from rl_trainer.transitions import Transition

MakeTransition = Callable[..., Transition]
SMALL = {"hidden1": 96, "hidden2": 64, "batch": 128, "actor_rate": 2e-3, "critic_rate": 2e-3, "polyak": 5e-3}
DDPG, REGRESSION = {"learner": "ddpg"}, {"learner": "regression"}
STORED = {"learner": "ddpg", "relabel": False}


def trained(parameters: TrainingParameters, make: MakeTransition, updates: int) -> Trainer:
    rng, trainer = np.random.default_rng(0), Trainer(parameters)
    for _ in range(1500):
        trainer.replay.add(make(parameters.problem, rng))
    trainer.learn(updates)
    return trainer


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
def test_closed_form_errors_are_recovered(
    problem: Problem, changes: dict[str, Any], updates: int, random_transition: MakeTransition, truth: Any
) -> None:
    """At states and mu not trained on, the corrections explain >= 95% of the variance of the true errors."""
    trainer = trained(TrainingParameters(problem=problem, **SMALL, **changes), random_transition, updates)
    policy, rng = ActorPolicy(trainer.policy_file()), np.random.default_rng(1)
    wrong, size = [], []
    for _ in range(300):
        fresh = random_transition(problem, rng)
        estimates = policy.act(fresh.observation, fresh.LgV)
        alpha, beta = truth(problem, fresh.observation, fresh.LgV)
        wrong.append(estimates.error(fresh.mu) - (alpha @ fresh.mu + beta))
        size.append(alpha @ fresh.mu + beta)
    share = np.square(wrong).mean(axis=0) / np.square(size).mean(axis=0)
    assert share.max() < 0.05, share


@pytest.mark.parametrize(
    "parameters",
    [
        paper_literal(RL_CBF_CLF_QP, hidden1=32, hidden2=24),
        paper_literal(IO_RL_CLF_QP, hidden1=32, hidden2=24),
        TrainingParameters(critic="plain", hidden1=32, hidden2=24),
        TrainingParameters(critic="plain", heads="one", relabel=False, discount=0.9, hidden1=32, hidden2=24),
        TrainingParameters(error_norm="absolute", critic_loss="squared", hidden1=32, hidden2=24),
        TrainingParameters(relabel=False, shared=False, observe_l_min=False, hidden1=32, hidden2=24),
    ],
)
def test_every_variant_learns_without_a_nan(parameters: TrainingParameters, random_transition: MakeTransition) -> None:
    trainer = trained(parameters, random_transition, 30)
    assert all(weight.isfinite().all() for weight in trainer.learner.acting.parameters())
    assert np.isfinite(list(trainer.learn(5).values())).all()


def test_value_of_a_constant_reward(random_transition: MakeTransition) -> None:
    """With reward -1 everywhere the critic's value tends to -1 / (1 - discount), and to -1 where the pose fails."""
    parameters = paper_literal(
        RL_CLF_QP,
        discount=0.5,
        hidden1=32,
        hidden2=24,
        polyak=0.05,
        critic_rate=3e-3,
        actor_rate=1e-9,
        error_scale=(1.0,),
    )
    rng = np.random.default_rng(2)
    unit_error = {"measured": np.array([1.0]), "nominal": np.zeros(1)}
    going, failed = (
        as_batch([random_transition(parameters.problem, rng, failed=f, **unit_error) for _ in range(64)], parameters)
        for f in (False, True)
    )
    failed.penalty.zero_()
    for batch, value in ((going, -2.0), (failed, -1.0)):
        torch.manual_seed(0)
        learner = Ddpg(parameters)
        for _ in range(600):
            learner.update(batch, 1.0)
        with torch.no_grad():
            q = learner._next_value(batch)
        assert q.mean().item() == pytest.approx(value, abs=0.1)


def test_the_same_seed_gives_the_same_weights(random_transition: MakeTransition) -> None:
    parameters = TrainingParameters(hidden1=16, hidden2=12)
    versions = [trained(parameters, random_transition, 20).policy_file().version for _ in range(2)]
    assert versions[0] == versions[1]
    other = trained(TrainingParameters(hidden1=16, hidden2=12, seed=2), random_transition, 20)
    assert other.policy_file().version != versions[0]
