"""A training that goes on from a policy."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
import torch
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.uncertainty import PAPER, RL_CLF_QP
from rl_cbf_clf_controller.weights import PROBE, PolicyFile, PolicyFileError
from rl_trainer import training
from rl_trainer.parameters import TrainingParameters
from rl_trainer.training import Trainer
from rl_trainer.transitions import Transition

SMALL = {"hidden1": 12, "hidden2": 9}


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
    parameters = TrainingParameters(problem=problem, learner=learner, **SMALL)
    given, trainer = policy(parameters), Trainer(parameters)
    trainer.start_from(given)
    mine = trainer.policy_file()
    for name, array in given.arrays.items():
        np.testing.assert_allclose(mine.arrays[name], array, atol=1e-6 if name == PROBE else 0)


def test_the_policy_stays_until_the_critic_has_learned(
    monkeypatch: pytest.MonkeyPatch, random_transition: Callable[..., Transition]
) -> None:
    monkeypatch.setattr(training, "CRITIC_FIRST", 6)
    parameters, rng = TrainingParameters(batch=8, **SMALL), np.random.default_rng(0)
    given, trainer = policy(parameters), Trainer(parameters)
    trainer.start_from(given)
    for _ in range(20):
        trainer.replay.add(random_transition(parameters.problem, rng))
    same = []
    for _ in range(9):
        trainer.learn(1)
        same.append(np.array_equal(trainer.policy_file().arrays["0.weight"], given.arrays["0.weight"]))
    assert same == [True] * 6 + [False] * 3


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"problem": RL_CLF_QP}, "problem"),
        ({"observe_l_min": False}, "observation"),
        ({"structured": False}, "structured"),
        ({"alpha_scale": (1.0, 2.0, 3.0, 4.0, 5.0)}, "alpha_scale"),
        ({"beta_scale": (1.0, 2.0, 3.0, 4.0, 5.0)}, "beta_scale"),
        ({"hidden1": 13}, "hidden"),
    ],
)
def test_a_policy_of_another_form_is_refused(changes: dict[str, Any], word: str) -> None:
    given = policy(TrainingParameters(hidden1=10, hidden2=15))
    trainer = Trainer(TrainingParameters(**({"hidden1": 10, "hidden2": 15} | changes)))
    before = trainer.policy_file().version
    with pytest.raises(PolicyFileError, match=word):
        trainer.start_from(given)
    assert trainer.policy_file().version == before
