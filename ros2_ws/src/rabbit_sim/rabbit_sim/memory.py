"""Where the simulator stands, in a file that outlives its process: one that is started again counts on from there.

So episode numbers and simulated time are unique in a graph and in its recordings, whoever was killed and when. The file
is mapped into memory: noting a tick costs nothing, and what a killed process has noted is there.
"""

from dataclasses import astuple, dataclass
from pathlib import Path

import numpy as np

_SIZE, _WORD = 4, np.uint64
_LARGEST = (2**32 - 2, 2**32 - 1, 2**31 * 100 - 1, 1)  # as the messages hold them


class MemoryFileError(RuntimeError):
    """A file that cannot be used, in one line."""


@dataclass(frozen=True)
class Stand:
    """Number of the newest episode, its tick, ticks since the clock began, and whether the episode is running."""

    episode: int = 0
    tick: int = 0
    clock_ticks: int = 0
    running: bool = False


class Memory:
    """The file; without a `path` nothing is kept."""

    def __init__(self, path: Path | None) -> None:
        """Raises `MemoryFileError` for a file that is no such memory, or cannot be written."""
        if path is None:
            self._words = np.zeros(_SIZE, _WORD)
            return
        try:
            if not path.exists():
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(bytes(_SIZE * 8))  # a mapped file without its bytes on disk could not tell a full one
            if path.stat().st_size != _SIZE * 8:
                raise MemoryFileError(f"memory {path}: expected a file of {_SIZE * 8} bytes, or none")
            self._words = np.memmap(path, _WORD, "r+", shape=(_SIZE,))
        except OSError as error:
            raise MemoryFileError(f"memory {path}: {error.strerror}") from error
        if any(int(word) > most for word, most in zip(self._words, _LARGEST, strict=True)):
            raise MemoryFileError(f"memory {path}: {[int(word) for word in self._words]} is no episode, tick and clock")

    @property
    def stand(self) -> Stand:
        """What was noted last."""
        episode, tick, clock_ticks, running = (int(word) for word in self._words)
        return Stand(episode, tick, clock_ticks, bool(running))

    def note(self, stand: Stand) -> None:
        """Keep where the simulator stands."""
        self._words[:] = astuple(stand)
