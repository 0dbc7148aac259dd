"""A run or a recording that walks beside a live robot: its rows, one a tick."""

from functools import cache
from pathlib import Path
from typing import Any

from rabbit_experiments.walk_records import WalkRecords

from rabbit_viewer.limp_fall import with_fall
from rabbit_viewer.page.recording import Recorded, recorded
from rabbit_viewer.play.settings import RECORDED
from rabbit_viewer.walk_pictures import records_of


class RecordedWalker:
    """What a `Player` shows of a `Walker`; nothing changes it."""

    def __init__(self, source: Path) -> None:
        """Raises `RecordsError`, `RecordingError`."""
        self._source = source
        self._walk = read(source)
        self.about = {**self._walk.walker, "name": RECORDED, "title": self._walk.title}
        self._next = 0
        self.row: list[float] = []

    @property
    def outcome(self) -> str:
        """Empty while it walks."""
        return str(self._walk.ended["outcome"]) if self._next == len(self._walk.rows) else ""

    @property
    def ended(self) -> dict[str, Any]:
        """As of a `Walker`."""
        return {**self._walk.ended, "outcome": self.outcome}

    @property
    def records(self) -> WalkRecords:
        """All of it and its fall, for a film."""
        return with_fall(records_of(self._source))

    def tick(self) -> None:
        """Go on one tick; nothing, once the recording has ended."""
        if not self.outcome:
            self.row = self._walk.rows[self._next]
            self._next += 1

    def explain(self, tick: int) -> list[str]:
        """What explains a recorded tick."""
        raise ValueError(f"tick {tick} of a recording: `rabbit bag explain RUN/recording --tick {tick}` explains it")


@cache
def read(source: Path) -> Recorded:
    """It is read once, however often it walks."""
    return recorded(records_of(source), source.name)
