"""A run or a recording that walks beside a live robot: its rows, one a tick."""

from functools import cache
from pathlib import Path
from typing import Any

from rabbit_experiments.walk_records import WalkRecords

from rabbit_viewer.limp_fall import with_fall
from rabbit_viewer.page.recording import ended_of, maker_of, ticks
from rabbit_viewer.play.settings import RECORDED
from rabbit_viewer.walk_pictures import records_of


class RecordedWalker:
    """What a `Player` shows of a `Walker`; nothing changes it."""

    def __init__(self, source: Path) -> None:
        """Raises `RecordsError`, `RecordingError`."""
        self._source = source
        self.about, self._rows, self._ended = read(source)
        self._next = 0
        self.row: list[float] = []

    @property
    def outcome(self) -> str:
        """Empty while it walks."""
        return str(self._ended["outcome"]) if self._next == len(self._rows) else ""

    @property
    def ended(self) -> dict[str, Any]:
        """As of a `Walker`."""
        return {**self._ended, "outcome": self.outcome}

    @property
    def records(self) -> WalkRecords:
        """All of it and its fall, for a film."""
        return with_fall(records_of(self._source))

    def tick(self) -> None:
        """Go on one tick; nothing, once the recording has ended."""
        if not self.outcome:
            self.row = self._rows[self._next]
            self._next += 1

    def explain(self, tick: int) -> list[str]:
        """What explains a recorded tick."""
        raise ValueError(f"tick {tick} of a recording: `rabbit bag explain RUN/recording --tick {tick}` explains it")


@cache
def read(source: Path) -> tuple[dict[str, Any], list[list[float]], dict[str, Any]]:
    """What the page needs to draw its rows, the rows, how it ended."""
    walk = records_of(source)
    maker = maker_of(walk)
    about = {**maker.about(RECORDED), "title": str(walk.about.get("title", source.name))}
    return about, [maker.row(tick, tick) for tick in ticks(walk)], ended_of(walk)
