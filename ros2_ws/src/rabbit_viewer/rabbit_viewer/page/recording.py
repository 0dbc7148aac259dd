"""A run or a recording on the page: all rows at once, and a time line to drag."""

import threading
import time
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from pydantic import ValidationError
from rabbit_common.guard import guarded
from rabbit_description.bounded_file import exists
from rabbit_description.state import StonePreview
from rabbit_experiments.walk_records import ARRAYS, RECORDS, SEEN, WalkRecords
from rabbit_recording.explaining import explain_tick

from rabbit_viewer.page import Explain
from rabbit_viewer.page.broadcast import Broadcast
from rabbit_viewer.page.files import write_page
from rabbit_viewer.page.rows import RowMaker, packed
from rabbit_viewer.page.server import PageServer
from rabbit_viewer.walk_pictures import bag_of, records_of


@dataclass
class Recorded:
    """One whole walk for the page: what it needs to draw the `rows` of the `walker`, and how that ended.

    `explains`: its ticks can be explained.
    """

    title: str
    tick_seconds: float
    walker: dict[str, Any]
    rows: list[list[float]]
    ended: dict[str, Any]
    stones: int | None = None
    explains: bool = True

    def tell(self, broadcast: Broadcast) -> None:
        """Tell all of it."""
        about = {name: getattr(self, name) for name in ("title", "tick_seconds", "stones")}
        about |= {"explains": True} if self.explains else {}
        broadcast.begin({"mode": "recording", **about, "walkers": [self.walker]})
        broadcast.add(packed([number for row in self.rows for number in row]))
        broadcast.say("ended", {"walkers": [self.ended]})


def recorded(walk: WalkRecords, name: str) -> Recorded:
    """A walk of RABBIT; `name`: where its records give none."""
    about = walk.about
    quantities = about.get("quantities", [f"quantity {i + 1}" for i in range(walk.nominal_b.shape[1])])
    maker = RowMaker(about, quantities, walk.barrier_names)
    outcome = str(about.get("outcome") or "not recorded to its end")
    return Recorded(
        title=str(about.get("title", name)),
        tick_seconds=walk.tick_seconds,
        walker=maker.about(str(about.get("controller", name))),
        rows=[maker.row(tick, tick) for tick in ticks(walk)],
        ended={"outcome": outcome, "stones": int(walk.touchdowns[-1])},
        stones=about.get("stones"),
    )


def show_recording(source: Path, port: int, opens_browser: bool, export: Path | None, episode: int | None) -> None:
    """Serve a run's folder or a recording until Ctrl-C, or write it to the file `export`.

    Raises:
        RecordsError, RecordingError: not readable, or no such episode in it.
        PageError: the port is taken, or the file cannot be written.
    """
    bag = bag_of(source)
    walk = recorded(records_of(source, episode), source.name)
    walk.explains = not exists(bag / RECORDS)  # its ticks are there, and not the arrays alone
    show(walk, lambda tick: explain_tick(bag, tick, episode).lines(), port, opens_browser, export)


def show(
    walk: Recorded, explain: Callable[[int], list[str]], port: int, opens_browser: bool, export: Path | None
) -> None:
    """Serve a walk until Ctrl-C, or write it to the file `export`; raises `PageError`.

    `explain` gives a tick in words.
    """
    broadcast = Broadcast()
    walk.explains &= not export
    walk.tell(broadcast)
    if export:
        print(write_page(export, broadcast))
        return
    with closing(PageServer(broadcast, Explainer(broadcast, explain), port)) as page, suppress(KeyboardInterrupt):
        page.announce(opens_browser)
        while True:
            time.sleep(1)


class Explainer:
    """Explains ticks of a recording, one at a time, in another thread: a replay takes a second or more."""

    def __init__(self, broadcast: Broadcast, explain: Callable[[int], list[str]]) -> None:
        self._broadcast, self._lines = broadcast, explain
        self._thread = threading.Thread()

    def __call__(self, message: str) -> str:
        """Answer a browser: empty, or why the message is refused."""
        try:
            asked = Explain.model_validate_json(message)
        except ValidationError:
            return "a recording takes no messages but explain"
        if self._thread.is_alive():
            return "another tick is being explained: ask again"
        self._thread = threading.Thread(target=self._explain, args=(asked.tick,), daemon=True)
        self._thread.start()
        return ""

    def _explain(self, tick: int) -> None:
        lines = guarded(self._lines, lambda reason, _: [reason])(tick)
        self._broadcast.say("explained", {"walker": 0, "tick": tick, "lines": lines})


def ticks(walk: WalkRecords) -> list[Any]:
    """The ticks, with the fields of `RobotState` and `ControllerOutput` that a row needs."""
    names = ARRAYS.keys() - {*SEEN, "landings"}
    ticks = [SimpleNamespace(**{name: getattr(walk, name)[row] for name in names}) for row in range(len(walk.tick))]
    for tick, (near, far), height in zip(ticks, walk.preview.tolist(), walk.stone_height.tolist(), strict=True):
        tick.preview = StonePreview(tick.touchdowns + 1, near, far, height) if np.isfinite(near) else None
    return ticks
