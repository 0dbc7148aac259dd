"""What must hold after a fault: of the trainer's folder and of a recording."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rabbit_recording.bag_writer import RecordingError
from rabbit_recording.recover import recover
from rabbit_recording.stored_messages import recorded_turns
from rl_trainer.journal import Journal
from rl_trainer.node_checkpoint import NodeCheckpoint
from rl_trainer.parameters import TrainingParameters
from rl_trainer.publication_gate import PublicationGate
from rl_trainer.training import Trainer
from rl_trainer.transitions import Transition

from rabbit_campaigns.faults.recording_checks import MonitorRecord, misreadings


@dataclass(frozen=True)
class TransitionsCheck:
    """Of the transitions told: how many are nowhere on disk, and how many the trainer counts in all."""

    told: int
    kept: int
    lost: int


def check_transitions(told: Iterable[Transition], folder: Path, parameters: TrainingParameters) -> TransitionsCheck:
    """Look for every transition told in checkpoint and journal; the trainer must not be running.

    Those that the trainer leaves out by rule are only counted, once they are in a checkpoint. For a trainer that plans
    episodes: one that learns beside the walk holds out one step in five (its gate), which would be taken for lost.
    """
    told = list(told)
    trainer = Trainer(parameters)
    kept = NodeCheckpoint(folder, trainer, PublicationGate(parameters))
    _, in_journal = Journal(folder, parameters).read(trainer.episode)
    learned = trainer.replay.rows(slice(0, len(trainer.replay)))
    columns = (learned.observation, learned.mu, learned.LgV, learned.next_mu)
    there = {row.tobytes() for row in np.hstack([column.numpy() for column in columns])}
    there |= {_key(transition, parameters) for transition in in_journal}
    lost = sum(trainer.replay.accepts(each) and _key(each, parameters) not in there for each in told)
    total = kept.taken + len(in_journal)
    return TransitionsCheck(len(told), total, max(lost, len(told) - total))


def _key(transition: Transition, parameters: TrainingParameters) -> bytes:
    """A row of the replay buffer, as it is held there."""
    m = len(parameters.observation)
    values = (transition.observation[:m], transition.mu, transition.LgV, transition.next_mu)
    return np.concatenate(values).astype(np.float32).tobytes()


@dataclass(frozen=True)
class RecordingCheck:
    """Whether it can be read, perhaps after `recover`; how many of the wanted ticks are not in it; what is misread."""

    readable: bool
    ticks: int
    missing: int
    misread: tuple[str, ...] = ()


def check_recording(path: Path, wanted: Iterable[tuple[int, int]], said: MonitorRecord | None) -> RecordingCheck:
    """Read a recording, as it is or recovered, and look for the `wanted` states from the first that is in it.

    What is read of it is held against what a witness `said`; None: strangers were in it, which say what they like.
    """
    whole = path
    try:
        if not (path / "metadata.yaml").is_file():
            whole = recover(path).path
        there = set(recorded_ticks(whole))
        misread = misreadings(whole, said) if said else []
    except RecordingError as error:
        return RecordingCheck(False, 0, 0, (str(error),))
    first = min(there, default=(2**32, 0))
    missing = sum(turn >= first and turn not in there for turn in wanted)
    return RecordingCheck(True, len(there), missing, tuple(misread))


def recorded_ticks(path: Path) -> list[tuple[int, int]]:
    """Episode and tick of each state in a recording."""
    return recorded_turns(path, "state")
