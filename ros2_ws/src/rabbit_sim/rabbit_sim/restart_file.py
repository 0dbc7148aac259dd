"""Where the simulator stands, in a file that outlives its process: one that is started again counts on from there.

So episode numbers and simulated time are unique in a graph and in its recordings, whoever was killed and when. The file
is mapped into memory: noting a tick costs nothing, and what a killed process has noted is there.
"""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

_LARGEST = {"episode": 2**32 - 2, "tick": 2**32 - 1, "clock_ticks": 2**31 * 100 - 1, "running": 1}
_LARGEST |= {"touchdowns": 2**32 - 1, "seed": 2**64 - 1}  # as the messages hold them
_LAYOUT = np.dtype([*((name, "<u8") for name in _LARGEST), ("sigma", "<f8"), ("policy_version", "S64")])


class RestartFileError(RuntimeError):
    """A file that cannot be used, in one line."""


@dataclass(frozen=True)
class RestartPoint:
    """The newest episode, its tick, and ticks since the clock began; whether it is running, and how it was begun.

    `sigma` is NaN where that of the controller holds; all is 0 before the first episode.
    """

    episode: int = 0
    tick: int = 0
    clock_ticks: int = 0
    running: bool = False
    touchdowns: int = 0
    seed: int = 0
    sigma: float = 0.0
    policy_version: str = ""


class RestartFile:
    """The file; without a `path` nothing is kept."""

    def __init__(self, path: Path | None) -> None:
        """Raises `RestartFileError` for a file that is no such memory, or cannot be written."""
        if path is None:
            self._kept = np.zeros(1, _LAYOUT)
            return
        try:
            if not path.exists():
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(bytes(_LAYOUT.itemsize))  # bytes on disk: else a mapped file could not tell a full one
            if path.stat().st_size != _LAYOUT.itemsize:
                raise RestartFileError(f"memory {path}: expected a file of {_LAYOUT.itemsize} bytes, or none")
            self._kept = np.memmap(path, _LAYOUT, "r+", shape=(1,))
        except OSError as error:
            raise RestartFileError(f"memory {path}: {error.strerror}") from error
        wrong = [name for name, most in _LARGEST.items() if int(self._kept[name][0]) > most]
        if wrong or self._kept["sigma"][0] < 0 or not bytes(self._kept["policy_version"][0]).isascii():
            raise RestartFileError(f"memory {path}: {self._kept[0]} is not where a simulator stands")

    @property
    def stand(self) -> RestartPoint:
        """What was noted last."""
        *numbers, policy = self._kept[0].item()
        values = dict(zip(_LAYOUT.names or (), (*numbers, policy.decode("ascii")), strict=True))
        return RestartPoint(**{**values, "running": bool(values["running"])})

    def note(self, **values: Any) -> None:
        """Keep values of a `RestartPoint`, by name."""
        kept = self._kept[0]
        for name, value in values.items():
            kept[name] = value
