"""A trainer that is killed at any moment goes on with every transition that it told."""

import multiprocessing
import resource
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.uncertainty import RL_CLF_QP
from rl_trainer import session
from rl_trainer.journal import Journal
from rl_trainer.learning_thread import LearningThread
from rl_trainer.node_checkpoint import NodeCheckpoint
from rl_trainer.parameters import TrainingParameters
from rl_trainer.publication_gate import PublicationGate
from rl_trainer.rollout import Record, rollout
from rl_trainer.session import CheckpointError, read_checkpoint
from rl_trainer.training import Trainer
from rl_trainer.transitions import Transition

PARAMETERS = TrainingParameters(
    problem=RL_CLF_QP, batch=8, updates_least=2, hidden1=6, hidden2=5, capacity=500, leave_out=()
)
FORK = multiprocessing.get_context("fork")
FIELDS = ("observation", "LgV", "mu", "mu_qp", "alpha", "beta", "nominal", "measured", "next_observation", "next_mu")


class Told:
    """Keeps the transitions that were told."""

    def __init__(self) -> None:
        self.transitions: list[Transition] = []
        self.plans = 0

    def on_plan(self, plan: Any, after: int) -> None:
        self.plans += 1

    def on_transition(self, transition: Transition, tag: Any) -> None:
        self.transitions.append(transition)

    def on_policy(self, policy: Any) -> None: ...

    def on_verdict(self, verdict: Any) -> None: ...

    def on_report(self, report: Any) -> None: ...


def walk(learning: LearningThread, world: Any, make_controller: Any, episode: int, ends: bool) -> None:
    """An episode, handed over in this thread; `ends`: to its end."""

    def observe(record: Record) -> None:
        learning.tick(record.state, record.output)
        learning._queue.get()()

    last = rollout(world, make_controller(ZeroPolicy(PARAMETERS.problem), 1.0), episode, observe)
    if ends:
        learning.end(last, episode)
        learning._queue.get()()


def begun(folder: Path, told: Told) -> LearningThread:
    """A learning thread's object whose thread is not started: the test takes what it would take."""
    learning = LearningThread(Trainer(PARAMETERS), told, folder=folder)
    learning._plan = learning.trainer.begin_episode()
    for transition in learning.kept.begin():
        learning.trainer.take(transition)
    return learning


def assert_same(one: Transition, other: Transition) -> None:
    """Every number."""
    for name in FIELDS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    assert (one.tick, one.step_index, one.failed, one.doubt) == (
        other.tick,
        other.step_index,
        other.failed,
        other.doubt,
    )


def test_what_was_told_in_a_broken_episode_is_learned_from(tmp_path: Path, toy_world: Any, toy_controller: Any) -> None:
    told = Told()
    walk(begun(tmp_path, told), toy_world, toy_controller, 1, ends=False)  # and is never heard of again
    _, held = Journal(tmp_path, PARAMETERS).read(0)
    for one, other in zip(held, told.transitions, strict=True):
        assert_same(one, other)
    again = begun(tmp_path, Told())
    assert again.kept.taken == len(told.transitions) > 0
    assert again.trainer.replay.added == sum(again.trainer.replay.accepts(each) for each in told.transitions) > 0


def test_after_an_episode_all_is_in_the_checkpoint(tmp_path: Path, toy_world: Any, toy_controller: Any) -> None:
    told = Told()
    learning = begun(tmp_path, told)
    walk(learning, toy_world, toy_controller, 1, ends=True)
    assert [path.name for path in tmp_path.glob("journal-*")] == ["journal-000001.bin"]
    again = begun(tmp_path, Told())
    assert again.kept.taken == len(told.transitions)
    assert again.trainer.replay.added == learning.trainer.replay.added
    assert again.trainer.policy_file().version == learning.trainer.policy_file().version


def test_a_kill_between_checkpoint_and_journal_doubles_nothing(
    tmp_path: Path, toy_world: Any, toy_controller: Any
) -> None:
    told = Told()
    learning = begun(tmp_path, told)
    walk(learning, toy_world, toy_controller, 1, ends=False)
    old = (tmp_path / "journal-000000.bin").read_bytes()
    learning.end(None, 1)
    learning._queue.get()()
    (tmp_path / "journal-000001.bin").unlink()
    (tmp_path / "journal-000000.bin").write_bytes(old)
    again = begun(tmp_path, Told())
    assert again.kept.taken == len(told.transitions)
    assert not (tmp_path / "journal-000000.bin").exists()


def test_what_is_held_out_comes_back(tmp_path: Path, toy_world: Any, toy_controller: Any) -> None:
    gate, trainer = PublicationGate(PARAMETERS), Trainer(PARAMETERS)
    told = Told()
    walk(begun(tmp_path / "other", told), toy_world, toy_controller, 1, ends=False)
    gate.held_out.extend(told.transitions)
    kept = NodeCheckpoint(tmp_path, trainer, gate)
    kept.begin()
    kept.save()
    other = PublicationGate(PARAMETERS)
    NodeCheckpoint(tmp_path, Trainer(PARAMETERS), other)
    for one, two in zip(other.held_out, gate.held_out, strict=True):
        assert_same(one, two)


def test_a_checkpoint_with_other_records_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    NodeCheckpoint(tmp_path, Trainer(PARAMETERS), PublicationGate(PARAMETERS)).begin()
    NodeCheckpoint(tmp_path, Trainer(PARAMETERS), PublicationGate(PARAMETERS)).save()
    state = read_checkpoint(tmp_path)
    assert state is not None
    state["more"]["record"] -= 16
    monkeypatch.setattr(session, "read_checkpoint", lambda _: state)
    with pytest.raises(CheckpointError, match="another version"):
        NodeCheckpoint(tmp_path, Trainer(PARAMETERS), PublicationGate(PARAMETERS))


def test_a_journal_of_other_parameters_is_refused(tmp_path: Path) -> None:
    NodeCheckpoint(tmp_path, Trainer(PARAMETERS), PublicationGate(PARAMETERS)).begin()
    other = PARAMETERS.model_copy(update={"seed": 7})
    with pytest.raises(CheckpointError, match="made with other parameters"):
        NodeCheckpoint(tmp_path, Trainer(other), PublicationGate(other)).begin()


def take_until_full(folder: Path, transition: Transition, result: Any) -> None:
    """Files may not grow: the error is told once, and nothing is raised."""
    kept = NodeCheckpoint(folder, Trainer(PARAMETERS), PublicationGate(PARAMETERS))
    kept.begin()
    may_be_told = [kept.add(transition)]
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, 0))
    may_be_told += [kept.add(replace(transition, tick=9)), kept.add(replace(transition, tick=10))]
    kept.save()
    is_right = "not kept any more" in kept.error and may_be_told == [True, False, False]
    result.value = int(is_right) + 2 * kept.taken


def test_a_full_disk_stops_the_keeping_not_the_learning(tmp_path: Path, toy_world: Any, toy_controller: Any) -> None:
    told = Told()
    walk(begun(tmp_path / "other", told), toy_world, toy_controller, 1, ends=False)
    result = FORK.Value("q", -1, lock=False)
    process = FORK.Process(target=take_until_full, args=(tmp_path / "full", told.transitions[0], result))
    process.start()
    process.join(60)
    assert (process.exitcode, result.value) == (0, 1 + 2 * 3)
    _, held = Journal(tmp_path / "full", PARAMETERS).read(0)
    assert [each.tick for each in held] == [told.transitions[0].tick]
