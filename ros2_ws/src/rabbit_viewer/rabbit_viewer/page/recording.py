"""A run or a recording on the page: all rows at once, and a time line to drag."""

import time
from contextlib import closing, suppress
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from rabbit_description.state import TICK_SECONDS, StonePreview
from rabbit_experiments.walk_records import ARRAYS, SEEN, WalkRecords

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
    fill(broadcast, records_of(source, episode), source.name)
    if export:
        print(write_page(export, broadcast))
    else:
        answer = "a recording takes no messages"
        with closing(PageServer(broadcast, lambda _: answer, port)) as page, suppress(KeyboardInterrupt):
            page.announce(opens_browser)
            while True:
                time.sleep(1)


def fill(broadcast: Broadcast, walk: WalkRecords, name: str) -> None:
    """Tell all of a walk."""
    maker = maker_of(walk)
    about = {"mode": "recording", "title": str(walk.about.get("title", name)), "tick_seconds": TICK_SECONDS}
    walker = maker.about(str(walk.about.get("controller", name)))
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
