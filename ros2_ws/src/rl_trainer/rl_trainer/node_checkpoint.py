"""What a learning node keeps in its folder, so that it can be killed at any time.

DIR/checkpoint.pt               all of the trainer after an episode, and what its gate measures by
DIR/journal-NNNNNN.bin          the transitions since then, each on disk before it is told
DIR/policies/NNN.safetensors    the policy after episode NNN

Where the disk is full nothing more is kept, which `error` says, and learning goes on.
"""

import contextlib
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import torch

from rl_trainer.journal import Journal, JournalError, from_records, record_type, to_records
from rl_trainer.publication_gate import PublicationGate
from rl_trainer.session import CHECKPOINT, CheckpointError, load_checkpoint, save_checkpoint
from rl_trainer.training import Trainer
from rl_trainer.transitions import Transition


class NodeCheckpoint:
    """The folder of a trainer and its gate; without a `folder` nothing is kept. `taken`: transitions ever taken in."""

    def __init__(self, folder: Path | None, trainer: Trainer, gate: PublicationGate) -> None:
        """Go on from what is there.

        Raises:
            CheckpointError: a training of other parameters, damaged, or a folder that cannot be made.
        """
        self._folder, self._trainer, self._gate = folder, trainer, gate
        self._journal = Journal(folder, trainer.parameters) if folder else None
        self.error, self.taken = "", 0
        if folder is None:
            return
        try:
            (folder / "policies").mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise CheckpointError(f"folder {folder}: {error.strerror}") from error
        if (folder / CHECKPOINT).exists():
            self._restore(folder / CHECKPOINT)

    def begin(self) -> list[Transition]:
        """Begin the journal of the trainer's episode; returns what it holds from before a kill.

        Raises:
            CheckpointError: the journal is of another training.
        """
        held: list[Transition] = []
        with self._stops_at_errors():
            try:
                held = self._journal.begin(self._trainer.episode) if self._journal else []
            except JournalError as error:
                raise CheckpointError(str(error)) from error
        self.taken += len(held)
        return held

    def add(self, transition: Transition) -> bool:
        """Keep a transition; returns whether it may be told: it is on disk, or nothing was to be kept."""
        self.taken += 1
        with self._stops_at_errors():
            if self._journal:
                self._journal.append(transition)
        return not self.error

    def save(self) -> None:
        """After an episode: checkpoint and policy, and the next episode's journal."""
        with self._stops_at_errors():
            if self._folder and self._journal:
                policy = self._trainer.policy_file()
                policy.write(self._folder / "policies" / f"{self._trainer.episode:03d}.safetensors")
                records = to_records(self._gate.held_out, self._trainer.parameters)
                held_out = torch.from_numpy(records.view(np.uint8).copy())
                more = {"taken": self.taken, "held_out": held_out, "record": records.itemsize}
                save_checkpoint(self._folder / CHECKPOINT, self._trainer, more)
                self._journal.begin(self._trainer.episode)

    def close(self) -> None:
        """Let go of the journal."""
        if self._journal:
            self._journal.close()

    def _restore(self, path: Path) -> None:
        more = load_checkpoint(path, self._trainer)
        self.taken = int(more.get("taken", self._trainer.replay.added))
        if "held_out" in more:  # not in those of `rabbit train`
            kind = record_type(self._trainer.parameters)
            if more.get("record") != kind.itemsize:
                raise CheckpointError(f"checkpoint {path}: its transitions are of another version; use another folder")
            records = more["held_out"].numpy().view(kind)
            self._gate.restore(from_records(records, self._trainer.parameters))

    @contextlib.contextmanager
    def _stops_at_errors(self) -> Iterator[None]:
        try:
            yield
        except (OSError, RuntimeError) as error:  # torch tells a full disk by a RuntimeError
            if isinstance(error, CheckpointError):
                raise
            self.error = f"folder {self._folder}: {error}; transitions, checkpoints and policies are not kept any more"
            self.close()
            self._journal = None
