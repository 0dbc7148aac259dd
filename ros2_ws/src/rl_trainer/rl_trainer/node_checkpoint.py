"""What a learning node keeps in its folder, so that it can be killed at any time.

DIR/checkpoint.pt               all of the trainer after an episode, and what its gate measures by
DIR/journal-NNNNNN.bin          the transitions since then, each on disk before it is published
DIR/policies/NNN.safetensors    the policy after episode NNN

Where the disk is full nothing more is kept, which `error` says, and learning goes on.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rabbit_description.bounded_file import one_line

from rl_trainer.journal import Journal, from_records, record_type, to_records
from rl_trainer.publication_gate import PublicationGate
from rl_trainer.session import CheckpointError, open_folder, save_episode
from rl_trainer.training import Trainer
from rl_trainer.transitions import Transition


class NodeCheckpoint:
    """The folder of a trainer and its gate; without a `folder` nothing is kept. `taken`: transitions ever taken in."""

    def __init__(self, folder: Path | None, trainer: Trainer, gate: PublicationGate) -> None:
        """Go on from what is there.

        Raises:
            CheckpointError: a training of other parameters, damaged, or a folder that cannot be made.
        """
        self._trainer, self._gate = trainer, gate
        self._journal = Journal(folder, trainer.parameters) if folder else None
        self.error, self.taken = "", 0
        if folder and (more := open_folder(folder, trainer)) is not None:
            try:
                self._restore(folder, more)
            except CheckpointError:
                raise
            except Exception as error:  # a damaged file may raise anything
                raise CheckpointError(f"folder {folder}: {one_line(error)}") from error

    def begin(self) -> list[Transition]:
        """Begin the journal of the trainer's episode; returns what it holds from before a kill.

        Raises:
            CheckpointError: the journal is of another training.
        """
        held: list[Transition] = self._keep(lambda journal: journal.begin(self._trainer.episode)) or []
        self.taken += len(held)
        return held

    def add(self, transition: Transition) -> bool:
        """Keep a transition; returns whether it may be published: it is on disk, or nothing was to be kept."""
        self.taken += 1
        self._keep(lambda journal: journal.append(transition))
        return not self.error

    def save(self) -> None:
        """After an episode: checkpoint and policy, and the next episode's journal."""
        self._keep(self._save)

    def close(self) -> None:
        """Let go of the journal."""
        if self._journal:
            self._journal.close()

    def _save(self, journal: Journal) -> None:
        records = to_records(self._gate.held_out, self._trainer.parameters)
        held_out = torch.from_numpy(records.view(np.uint8).copy())
        more = {"taken": self.taken, "held_out": held_out, "record": records.itemsize}
        save_episode(journal.folder, self._trainer, more)
        journal.begin(self._trainer.episode)

    def _restore(self, folder: Path, more: dict[str, Any]) -> None:
        self.taken = int(more.get("taken", self._trainer.replay.added))
        if "held_out" in more:  # not in those of `rabbit train`
            kind = record_type(self._trainer.parameters)
            if more.get("record") != kind.itemsize:
                raise CheckpointError(f"folder {folder}: its transitions are of another version; use another folder")
            records = more["held_out"].numpy().view(kind)
            self._gate.held_out.extend(from_records(records, self._trainer.parameters))

    def _keep(self, action: Callable[[Journal], Any]) -> Any:
        """What the action returns; None where nothing is kept, or not any more."""
        if self._journal is None:
            return None
        try:
            return action(self._journal)
        except CheckpointError:
            raise
        except (OSError, RuntimeError) as error:  # torch reports a full disk by a RuntimeError
            folder = self._journal.folder
            self.error = f"folder {folder}: {error}; transitions, checkpoints and policies are not kept any more"
            self.close()
            self._journal = None
            return None
