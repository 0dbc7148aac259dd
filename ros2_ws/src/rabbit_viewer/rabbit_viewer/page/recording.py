"""A run or a recording on the page: all rows at once, and a time line to drag."""

import threading
import time
from collections.abc import Callable
from contextlib import closing, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from pydantic import ValidationError
from rabbit_common.guard import guarded
from rabbit_description.bounded_file import exists
from rabbit_description.state import StonePreview
from rabbit_experiments.walk_records import ARRAYS, RECORDING, RECORDS, SEEN, WalkRecords
from rabbit_recording.explaining import explain_tick

from rabbit_viewer.page import Explain
from rabbit_viewer.page.broadcast import Broadcast
from rabbit_viewer.page.files import write_page
from rabbit_viewer.page.rows import RowMaker, packed
from rabbit_viewer.page.server import PageServer
from rabbit_viewer.walk_pictures import records_of


def show_recording(source: Path, port: int, opens_browser: bool, export: Path | None, episode: int | None) -> None:
    """Serve a run's folder or a recording until Ctrl-C, or write it to the file `export`.

    Raises:
        RecordsError, RecordingError: not readable, or no such episode in it.
        PageError: the port is taken, or the file cannot be written.
    """
    broadcast = Broadcast()
    bag = source / RECORDING if exists(source / RECORDING) else source
    has_ticks = not exists(bag / RECORDS)  # and not the arrays alone
    fill(broadcast, records_of(source, episode), source.name, has_ticks and not export)
    serve_or_write(broadcast, lambda tick: explain_tick(bag, tick, episode).lines(), port, opens_browser, export)


def serve_or_write(
    broadcast: Broadcast, explain: Callable[[int], list[str]], port: int, opens_browser: bool, export: Path | None
) -> None:
    """Serve what is told until Ctrl-C, or write it to the file `export`; raises `PageError`.

    `explain` gives a tick in words.
    """
    if export:
        print(write_page(export, broadcast))
        return
    with closing(PageServer(broadcast, Explainer(broadcast, explain), port)) as page, suppress(KeyboardInterrupt):
        page.announce(opens_browser)
        while True:
            time.sleep(1)


class Explainer:
    """Explains ticks of a recording, one at a time, in a thread of its own: a replay takes a second or more."""

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


def fill(broadcast: Broadcast, walk: WalkRecords, name: str, explains: bool = False) -> None:
    """Tell all of a walk; `explains`: its ticks can be explained."""
    maker = maker_of(walk)
    about: dict[str, Any] = {
        "mode": "recording",
        "title": str(walk.about.get("title", name)),
        "tick_seconds": walk.tick_seconds,
    }
    walker = maker.about(str(walk.about.get("controller", name)))
    about |= {"explains": True} if explains else {}
    broadcast.begin({**about, "stones": walk.about.get("stones"), "walkers": [walker]})
    rows = [number for tick in ticks(walk) for number in maker.row(tick, tick)]
    broadcast.add(packed(rows))
    broadcast.say("ended", {"walkers": [ended_of(walk)]})


def maker_of(walk: WalkRecords) -> RowMaker:
    """What makes the rows of its ticks."""
    quantities = walk.about.get("quantities", [f"quantity {i + 1}" for i in range(walk.nominal_b.shape[1])])
    return RowMaker(walk.about, quantities, walk.barrier_names)


def ended_of(walk: WalkRecords) -> dict[str, Any]:
    """How it ended, and the stones walked."""
    return {"outcome": str(walk.about.get("outcome") or "not recorded to its end"), "stones": int(walk.touchdowns[-1])}


def ticks(walk: WalkRecords) -> list[Any]:
    """Each tick with the fields of `RobotState` and `ControllerOutput` that a row needs."""
    names = ARRAYS.keys() - {*SEEN, "landings"}
    found = [SimpleNamespace(**{name: getattr(walk, name)[row] for name in names}) for row in range(len(walk.tick))]
    for tick, (near, far), height in zip(found, walk.preview.tolist(), walk.stone_height.tolist(), strict=True):
        tick.preview = StonePreview(tick.touchdowns + 1, near, far, height) if np.isfinite(near) else None
    return found
