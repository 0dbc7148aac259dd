"""What must hold after a fault: of the trainer's folder and of a recording."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rabbit_recording import RecordingError
from rabbit_recording.recover import recover
from rabbit_recording.stored_messages import stored_messages
from rl_trainer.checkpoint import Checkpoint, journal_path, read_journal
from rl_trainer.parameters import TrainingParameters
from rl_trainer.training import Trainer
from rl_trainer.transitions import Transition

from rabbit_campaigns.faults.recording_checks import MonitorRecord, misreadings

TRAINING = TrainingParameters(
    hidden1=16, hidden2=16, batch=16, updates_least=5, updates_per_tick=0.05, capacity=60_000, nominal_episodes=1
)


def check_transitions(told: Sequence[Transition], folder: Path) -> dict[str, int]:
    """Look for every transition told in checkpoint and journal of a training under `TRAINING`, whose trainer is away.

    Those that the trainer leaves out by rule are only counted, once they are in a checkpoint.

    Returns:
        How many are nowhere on disk, `lost`; how many the trainer counts in all, `kept`; and `told_transitions`.
    """
    trainer = Trainer(TRAINING)
    Checkpoint(folder, trainer)
    in_journal = read_journal(journal_path(folder, trainer.episode), TRAINING)
    learned = trainer.replay.rows(slice(0, len(trainer.replay)))
    columns = (learned.observation, learned.mu, learned.LgV, learned.next_mu)
    there = {row.tobytes() for row in np.hstack([column.numpy() for column in columns])}
    there |= {_key(transition) for transition in in_journal}
    lost = sum(trainer.replay.accepts(each) and _key(each) not in there for each in told)
    total = trainer.taken + len(in_journal)
    return {"lost": max(lost, len(told) - total), "kept": total, "told_transitions": len(told)}


def _key(transition: Transition) -> bytes:
    """A row of the replay buffer, as it is held there."""
    m = len(TRAINING.observation)
    values = (transition.observation[:m], transition.mu, transition.LgV, transition.next_mu)
    return np.concatenate(values).astype(np.float32).tobytes()


def check_recording(path: Path, wanted: Iterable[tuple[int, int]], said: MonitorRecord | None) -> dict[str, Any]:
    """Read a recording, as it is or recovered, and look for the `wanted` states from the first that is in it.

    What is read of it is held against what a witness `said`; None: strangers were in it, which say what they like.

    Returns:
        Whether it is `readable`, perhaps after `recover`; its `recorded_ticks`; how many of the wanted are `missing`;
        what is `misread`.
    """
    whole = path
    try:
        if not (path / "metadata.yaml").is_file():
            whole = recover(path).path
        with stored_messages(whole, "state") as states:
            there = {state.turn for state in states}
        misread = misreadings(whole, said) if said else []
    except RecordingError as error:
        return {"readable": False, "recorded_ticks": 0, "missing": 0, "misread": [str(error)]}
    first = min(there, default=(2**32, 0))
    missing = sum(turn >= first and turn not in there for turn in wanted)
    return {"readable": True, "recorded_ticks": len(there), "missing": missing, "misread": misread}
