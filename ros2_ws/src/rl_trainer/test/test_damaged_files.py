"""A bit that flips in a journal or a checkpoint is found: what was damaged is not taken, and training goes on."""

import itertools
import random
from pathlib import Path
from typing import Any

import pytest
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.uncertainty import RL_CLF_QP
from rl_trainer.checkpoint import BEFORE, CHECKPOINT, Checkpoint, CheckpointError
from rl_trainer.parameters import TrainingParameters
from rl_trainer.rollout import Record, rollout
from rl_trainer.session import resume
from rl_trainer.training import Trainer
from rl_trainer.transitions import Transition

PARAMETERS = TrainingParameters(
    problem=RL_CLF_QP, episodes=3, nominal_episodes=1, batch=8, updates_least=2, hidden1=6, hidden2=5, capacity=500
)
FLIPS = 300
SEED = 27


def flipped(data: bytes, bit: int) -> bytes:
    """With one bit that is another one."""
    return data[: bit // 8] + bytes([data[bit // 8] ^ 1 << bit % 8]) + data[bit // 8 + 1 :]


def flips(data: bytes) -> list[bytes]:
    """`FLIPS` times, each with another bit."""
    return [flipped(data, bit) for bit in random.Random(SEED).sample(range(8 * len(data)), FLIPS)]


@pytest.fixture
def transitions(toy_world: Any, toy_controller: Any) -> list[Transition]:
    """Of one walk."""
    trainer, found = Trainer(PARAMETERS), list[Transition]()
    trainer.begin_episode()

    def observe(record: Record) -> None:
        if (transition := trainer.observe(record.state, record.output)) is not None:
            found.append(transition)

    rollout(toy_world, toy_controller(ZeroPolicy(RL_CLF_QP), 1.0), 1, observe)
    return found


def test_no_flipped_bit_of_a_checkpoint_is_taken(
    tmp_path: Path, toy_world: Any, toy_controller: Any, caplog: pytest.LogCaptureFixture
) -> None:
    whole = Checkpoint(tmp_path, Trainer(PARAMETERS))
    list(itertools.islice(resume(whole, toy_world, toy_controller), 2))
    path = tmp_path / CHECKPOINT
    data = path.read_bytes()
    for damaged in flips(data):
        caplog.clear()
        path.write_bytes(damaged)
        assert Checkpoint(tmp_path, Trainer(PARAMETERS)).trainer.episode == 1
        assert f"checkpoint {path}: damaged" in caplog.text
        assert f"going on from {BEFORE}" in caplog.text
    again = Checkpoint(tmp_path, Trainer(PARAMETERS))
    assert [report.episode for report in resume(again, toy_world, toy_controller)] == [1, 2]
    list(resume(whole, toy_world, toy_controller))
    assert again.trainer.policy_file().encode() == whole.trainer.policy_file().encode()


def test_without_a_sound_checkpoint_nothing_is_taken(tmp_path: Path, toy_world: Any, toy_controller: Any) -> None:
    list(itertools.islice(resume(Checkpoint(tmp_path, Trainer(PARAMETERS)), toy_world, toy_controller), 2))
    for name in (CHECKPOINT, BEFORE):
        (tmp_path / name).write_bytes(flipped((tmp_path / name).read_bytes(), 999))
    with pytest.raises(CheckpointError, match=r"checkpoint\.pt: damaged"):
        Checkpoint(tmp_path, Trainer(PARAMETERS))
