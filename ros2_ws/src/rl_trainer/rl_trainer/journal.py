"""Transitions on disk in the moment they are taken in: a trainer that is killed loses none that it published.

A file for each episode of the training, from its first transition to the checkpoint after it, in which all are. One
line says of which training it is; then come records of one size, each with a checksum of line and record. A record cut
at the end is left out, a damaged one too, which is said. What is written is handed to the operating system, not synced:
a killed process loses nothing, a power cut may.
"""

import json
import logging
import zlib
from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from rabbit_description.bounded_file import FileError, read_bytes
from rabbit_description.state import Array

from rl_trainer.parameters import TrainingParameters
from rl_trainer.session import CheckpointError
from rl_trainer.transitions import Doubt, Transition

CHECKSUM = np.dtype("<u4")
MOST_BYTES = 500_000_000  # of an episode's journal; a transition has about a thousand
NUMBERS = {"tick": "<i8", "step_index": "<i8", "failed": "?", "doubt": "<i8"}

log = logging.getLogger(__name__)


def record_type(parameters: TrainingParameters) -> np.dtype[Any]:
    """A transition as bytes: float64 and int64, so that it comes back the same.

    There is room for the longest observation, with a gait library's step length; NaN fills it up.
    """
    m, n, inputs = len(parameters.problem.observations[-1]), parameters.n, parameters.problem.inputs
    shapes: dict[str, tuple[int, ...]] = dict.fromkeys(("LgV", "mu", "mu_qp", "next_LgV", "next_mu"), (inputs,))
    shapes |= {"observation": (m,), "next_observation": (m,), "alpha": (n, inputs)}
    shapes |= dict.fromkeys(("beta", "nominal", "measured"), (n,))
    names = [field.name for field in fields(Transition) if field.name != "problem"]
    return np.dtype([(n, NUMBERS[n]) if n in NUMBERS else (n, "<f8", shapes[n]) for n in names])


def to_records(transitions: Iterable[Transition], parameters: TrainingParameters) -> Array:
    """Transitions as an array of `record_type`."""
    kind = record_type(parameters)
    rows = [tuple(_filled(getattr(each, name), kind[name].shape) for name in kind.names or ()) for each in transitions]
    return np.array(rows, dtype=kind)


def _filled(value: Any, shape: tuple[int, ...]) -> Any:
    """A shorter observation, up to the room there is."""
    is_short = len(shape) == 1 and len(value) < shape[0]
    return np.pad(value, (0, shape[0] - len(value)), constant_values=np.nan) if is_short else value


def from_records(records: Array, parameters: TrainingParameters) -> list[Transition]:
    """The transitions again."""
    return [_transition(record, parameters) for record in records]


def _transition(record: Any, parameters: TrainingParameters) -> Transition:
    values: dict[str, Any] = {name: record[name].copy() for name in record.dtype.names if name not in NUMBERS}
    short = len(parameters.problem.observation)
    for name in ("observation", "next_observation"):
        values[name] = values[name][:short] if np.isnan(values[name][short:]).all() else values[name]
    values |= {name: int(record[name]) for name in ("tick", "step_index")}
    values |= {"doubt": Doubt(int(record["doubt"])), "failed": bool(record["failed"])}
    return Transition(problem=parameters.problem, **values)


def _content(path: Path) -> bytes:
    try:
        return read_bytes(path, MOST_BYTES) if path.exists() else b""
    except FileError as error:
        raise CheckpointError(f"journal {path}: {error}") from error


class Journal:
    """The journal of a training in its folder."""

    def __init__(self, folder: Path, parameters: TrainingParameters) -> None:
        self.folder, self._parameters = folder, parameters
        self._file: BinaryIO | None = None
        head = {"record": record_type(parameters).itemsize, "parameters": parameters.key}
        self._head = json.dumps(head).encode() + b"\n"

    def begin(self, episode: int) -> list[Transition]:
        """Go on with this episode's journal, and remove those before it: they are in the checkpoint.

        Returns:
            The transitions that it holds already.

        Raises:
            CheckpointError: of another training, or no journal.
            OSError: the disk is full, or cannot be written.
        """
        self.close()
        path = self._path(episode)
        for other in self.folder.glob("journal-*.bin"):
            if other.name < path.name:
                other.unlink()
        whole, held = self.read(episode)
        self._file = path.open("ab", buffering=0)
        self._file.truncate(whole)
        if not whole:
            self._write(self._head)
        return held

    def read(self, episode: int) -> tuple[int, list[Transition]]:
        """How many bytes of an episode's journal are not cut, and the sound transitions in them.

        Raises:
            CheckpointError: of another training, or none is sound.
        """
        path, head = self._path(episode), self._head
        data = _content(path)
        if head.startswith(data) and len(data) < len(head):
            return 0, []
        kind = np.dtype([("record", record_type(self._parameters)), ("checksum", CHECKSUM)])
        count = max(0, len(data) - len(head)) // kind.itemsize
        rows = np.frombuffer(data[len(head) :], kind, count)
        sound = rows[[self._checksum(row["record"].tobytes()) == row["checksum"] for row in rows]]
        if not data.startswith(head) and not len(sound):
            raise CheckpointError(f"journal {path}: made with other parameters, or damaged; use another folder")
        if not data.startswith(head) or len(sound) < count:
            log.warning("journal %s: damaged; %d of %d transitions are sound and taken", path, len(sound), count)
        return len(head) + rows.nbytes, from_records(sound["record"], self._parameters)

    def append(self, transition: Transition) -> None:
        """Add a transition; raises `OSError` where the disk is full."""
        record = to_records([transition], self._parameters).tobytes()
        self._write(record + CHECKSUM.type(self._checksum(record)).tobytes())

    def close(self) -> None:
        """Let go of the file."""
        if self._file is not None:
            self._file.close()
            self._file = None

    def _write(self, data: bytes) -> None:
        assert self._file is not None
        while data:  # a nearly full disk takes a part, then says so
            data = data[self._file.write(data) :]

    def _checksum(self, record: bytes) -> int:
        return zlib.crc32(record, zlib.crc32(self._head))

    def _path(self, episode: int) -> Path:
        return self.folder / f"journal-{episode:06d}.bin"
