"""What a training keeps in its folder, so that it can be killed at any time and goes on with nothing lost.

DIR/parameters.yaml             what was asked for
DIR/checkpoint.pt               all of the trainer after an episode, with a checksum; replaced at once or not at all
DIR/policies/NNN.safetensors    the policy after episode NNN
DIR/curve.csv                   how the episodes went, from 0; a cell is empty where one has no such number
DIR/journal-NNNNNN.txt          a node's transitions since then: a line of JSON each, after its checksum

A line is handed to the operating system before its transition is published, not synced: a killed process loses
nothing, a power cut may. An empty line between two others keeps a cut or damaged one from spoiling its neighbour.
"""

import hashlib
import io
import json
import logging
import zlib
from dataclasses import fields
from pathlib import Path
from typing import Any
from zipfile import ZipFile

import numpy as np
import torch
from rabbit_description.atomic_file import remove_partials, replace_table, replace_text, replacing
from rabbit_description.bounded_file import read_bytes
from rabbit_description.validation import one_line
from rabbit_description.yaml_file import dump_yaml

from rl_trainer.parameters import TrainingParameters
from rl_trainer.training import Trainer
from rl_trainer.transitions import Doubt, Transition

CHECKPOINT, CURVE = "checkpoint.pt", "curve.csv"
MOST_BYTES = 10_000_000_000  # of a checkpoint; 5,000,000 transitions have half of it
MOST_JOURNAL_BYTES = 500_000_000  # a transition has about three thousand
DIGEST = hashlib.sha256().digest_size  # bytes at the head of a checkpoint

log = logging.getLogger(__name__)


class CheckpointError(Exception):
    """A folder that training cannot go on from."""


class Checkpoint:
    """The folder of a trainer, which goes on from what is there."""

    def __init__(self, folder: Path, trainer: Trainer) -> None:
        """Raises `CheckpointError`: damaged, of other parameters (but for the number of episodes), or no folder."""
        self.folder, self.trainer = folder, trainer
        try:
            (folder / "policies").mkdir(parents=True, exist_ok=True)
            remove_partials(folder)
            if state := read_checkpoint(folder):
                self._restore(state)
            replace_text(folder / "parameters.yaml", dump_yaml(trainer.parameters.model_dump(mode="json")))
        except OSError as error:
            raise CheckpointError(f"folder {folder}: {error.strerror}") from error

    def begin(self) -> None:
        """Take in what the journal of the trainer's episode holds from before a kill; earlier ones are done with.

        Raises `CheckpointError`: it is of another training.
        """
        path = journal_path(self.folder, self.trainer.episode)
        for journal in self.folder.glob("journal-*"):
            if journal.name < path.name:
                journal.unlink()
        transitions = read_journal(path, self.trainer.parameters)
        try:
            for transition in transitions:
                self.trainer.take(transition)
        except Exception as error:  # sizes that do not fit
            raise CheckpointError(f"journal {path}: {one_line(error)}") from error

    def append(self, transition: Transition) -> None:
        """Add a transition to the journal of the trainer's episode; raises `OSError` where the disk is full."""
        data = line_of(transition, self.trainer.parameters)
        with journal_path(self.folder, self.trainer.episode).open("ab", buffering=0) as journal:
            while data:  # a nearly full disk takes a part, then says so
                data = data[journal.write(data) :]

    def save(self) -> None:
        """After an episode: the policy and all of the trainer's state; what journals hold is in there."""
        trainer, newest, content = self.trainer, self.folder / CHECKPOINT, io.BytesIO()
        trainer.policy_file().write(self.folder / "policies" / f"{trainer.episode:03d}.safetensors")
        replace_table(self.folder / CURVE, ({"episode": one.episode, **one.scalars} for one in trainer.reports))
        torch.save({"parameters": trainer.parameters.key, **trainer.state_dict()}, content)
        data = content.getvalue()
        with replacing(newest) as partial:
            partial.write_bytes(hashlib.sha256(data).digest() + data)
        for journal in self.folder.glob("journal-*"):
            journal.unlink()

    def _restore(self, state: dict[str, Any]) -> None:
        """Bring the trainer to where the checkpoint was taken."""
        name, trainer = f"checkpoint {self.folder / CHECKPOINT}", self.trainer
        if state.get("parameters") != trainer.parameters.key:
            raise CheckpointError(f"{name}: made with other parameters; use another folder, or the same ones")
        try:
            trainer.load_state_dict(state)
        except Exception as error:  # of a user's learner
            raise CheckpointError(f"{name}: {type(error).__name__}: {one_line(error, 200)}") from error


def read_checkpoint(folder: Path) -> dict[str, Any] | None:
    """What is in the folder, None where there is no checkpoint; raises `CheckpointError`: it is damaged."""
    path = folder / CHECKPOINT
    if not path.exists():
        return None
    try:
        data = read_bytes(path, MOST_BYTES)
        if hashlib.sha256(data[DIGEST:]).digest() != data[:DIGEST]:
            raise ValueError("damaged, or of another version: its checksum is not that of its content")
        content = io.BytesIO(data[DIGEST:])
        with ZipFile(content) as archive:  # torch writes no other, and would decompress whatever comes
            if any(part.file_size > part.compress_size for part in archive.infolist()):
                raise ValueError("compressed: expected plain tensors")
        content.seek(0)
        state = torch.load(content, weights_only=True)
        if not isinstance(state, dict) or not isinstance(state.get("episode"), int):
            raise ValueError("expected names with values, `episode` a whole number")
        return state
    except Exception as error:  # a damaged file may raise anything
        raise CheckpointError(f"checkpoint {path}: {one_line(error, 200)}") from error


def journal_path(folder: Path, episode: int) -> Path:
    """The journal of an episode."""
    return folder / f"journal-{episode:06d}.txt"


def read_journal(path: Path, parameters: TrainingParameters) -> list[Transition]:
    """The sound transitions of a journal, none where there is no file. What is cut or damaged is said.

    Raises:
        CheckpointError: none is sound.
    """
    if not path.exists():
        return []
    try:
        data = read_bytes(path, MOST_JOURNAL_BYTES)
        transitions, lines = transitions_of(data, parameters)
    except Exception as error:  # sound checksums of what is no transition
        raise CheckpointError(f"journal {path}: {one_line(error)}") from error
    if not transitions and data.endswith(b"\n") and lines:  # else the first one is cut
        raise CheckpointError(f"journal {path}: made with other parameters, or damaged; use another folder")
    if (sound := len(transitions)) < lines:
        log.warning("journal %s: cut or damaged; %d of %d transitions are sound and taken", path, sound, lines)
    return transitions


def line_of(transition: Transition, parameters: TrainingParameters) -> bytes:
    """A transition as a line, every number as it is."""
    names = [field.name for field in fields(Transition) if field.name != "problem"]
    text = json.dumps({name: np.asarray(getattr(transition, name)).tolist() for name in names}).encode()
    return b"\n%s %s\n" % (checksum(text, parameters.key), text)


def transitions_of(data: bytes, parameters: TrainingParameters) -> tuple[list[Transition], int]:
    """The sound transitions of these lines, and how many lines there are."""
    lines, transitions, key = [line for line in data.split(b"\n") if line], [], parameters.key
    for written_sum, _, text in (line.partition(b" ") for line in lines):
        if written_sum == checksum(text, key):
            values = json.loads(text)
            values = {name: np.array(value) if isinstance(value, list) else value for name, value in values.items()}
            values |= {"problem": parameters.problem, "doubt": Doubt(values["doubt"])}
            transitions.append(Transition(**values))
    return transitions, len(lines)


def checksum(text: bytes, key: str) -> bytes:
    """The checksum of the text and of the training that it belongs to, by its key."""
    return b"%08x" % zlib.crc32(text, zlib.crc32(key.encode()))
