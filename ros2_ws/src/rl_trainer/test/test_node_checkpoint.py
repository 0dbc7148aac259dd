"""A trainer that is killed at any moment goes on with every transition that it published."""

from pathlib import Path
from typing import Any

import numpy as np
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.uncertainty import RL_CLF_QP
from rl_trainer.checkpoint import journal_path, read_journal
from rl_trainer.learning_thread import LearningThread
from rl_trainer.parameters import TrainingParameters
from rl_trainer.rollout import Record, rollout
from rl_trainer.training import Trainer
from rl_trainer.transitions import Transition
from tiny_world import ToyController, ToyWorld

PARAMETERS = TrainingParameters(
    problem=RL_CLF_QP, batch=8, updates_least=2, hidden1=6, hidden2=5, capacity=500, every_tick=True
)


class Told:
    """Keeps the transitions that were published."""

    def __init__(self) -> None:
        self.transitions: list[Transition] = []

    def on_plan(self, plan: Any, after: int, report: Any) -> None: ...

    def on_transition(self, transition: Transition, tag: Any) -> None:
        self.transitions.append(transition)


def walk(learning: LearningThread, world: Any, make_controller: Any, episode: int, ends: bool) -> None:
    """An episode, handed over in this thread; `ends`: to its end."""

    def observe(record: Record) -> None:
        learning.tick(record.state, record.output)
        learning._queue.get()()

    last = rollout(world, make_controller(ZeroPolicy(PARAMETERS.problem), 1.0), episode, observe)
    if ends:
        learning.end(last, episode)
        learning._queue.get()()


def begun(folder: Path, listener: Told) -> LearningThread:
    """A learning thread's object whose thread is not started: the test takes what it would take."""
    learning = LearningThread(Trainer(PARAMETERS), listener, folder=folder)
    learning.take_up(0)
    return learning


def test_what_was_told_in_a_broken_episode_is_learned_from(tmp_path: Path) -> None:
    listener = Told()
    walk(begun(tmp_path, listener), ToyWorld(), ToyController, 1, ends=False)  # and is never heard of again
    held = read_journal(journal_path(tmp_path, 0), PARAMETERS)
    for one, other in zip(held, listener.transitions, strict=True):
        for name in vars(one):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name), name)
    again = begun(tmp_path, Told())
    assert again.trainer.taken == len(listener.transitions) > 0
    accepted = sum(map(again.trainer.replay.accepts, listener.transitions))
    assert again.trainer.replay.added == accepted > 0


def test_a_kill_between_checkpoint_and_journal_doubles_nothing(tmp_path: Path) -> None:
    listener = Told()
    learning = begun(tmp_path, listener)
    walk(learning, ToyWorld(), ToyController, 1, ends=False)
    old = journal_path(tmp_path, 0).read_bytes()
    learning.end(None, 1)
    learning._queue.get()()
    journal_path(tmp_path, 0).write_bytes(old)
    again = begun(tmp_path, Told())
    assert again.trainer.taken == len(listener.transitions)
    assert not journal_path(tmp_path, 0).exists()
