"""Walks in real time, alone and with busy neighbours, as ordinary processes and under SCHED_FIFO.

FOLDER/neighbours-N-priority-P/    each walk's parameters, logs and recording
FOLDER/jitter.json
"""

import contextlib
import os
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from rabbit_bringup.launching.walk import MOST_EPISODES, WalkOptions, WalkSettings
from rabbit_experiments.assembly import Assembly
from rabbit_recording.contents import contents
from rabbit_recording.timing import real_time_figures

from rabbit_campaigns.figures import ShowStatus

LATE_LIMIT = 0.001  # share of ticks
CUT_OFF = "reset"  # outcome of the episode in which the time was up
BUSY = "while True: pass"


def walk_beside(
    assembly: Assembly, folder: Path, seed: int, neighbours: int, priority: int, seconds: float, show_status: ShowStatus
) -> dict[str, Any]:
    """Walk for so many s, under `folder`, beside so many busy processes; `show_status` hears how far it is.

    `priority`: SCHED_FIFO of simulator and controller, or 0. Returns the walk's figures.

    Raises:
        LaunchError: a node cannot be started, ended by itself, or is not ready in time.
        Interrupted: by a signal.
    """
    from rabbit_bringup.ros.walk_monitor import walking

    name = f"neighbours-{neighbours}-priority-{priority}"
    (folder / name).mkdir(parents=True)
    many: dict[str, Any] = {"seed": seed, "episodes": MOST_EPISODES, "priority": priority}
    walk = WalkSettings.of(assembly, folder / name, WalkOptions(**many, trainer=False, real_time=True))
    load = os.getloadavg()[0]
    with busy(neighbours), walking(walk) as monitor:
        began = time.monotonic()
        while (so_far := time.monotonic() - began) < seconds:
            show_status(f"{name}: {so_far:.0f} of {seconds:.0f} s, episode {monitor.glance().episode}")
    about = {"neighbours": neighbours, "priority": priority, "load_before": load, "load_after": os.getloadavg()[0]}
    return {**about, **figures(walk.folder / "recording")}


def figures(recording: Path) -> dict[str, Any]:
    """The figures of one walk: timing, how its episodes ended, ticks lost on the way to the recorder."""
    recorded = contents(recording)
    outcomes = Counter(sorted(episode.outcome for episode in recorded.episodes if episode.outcome not in ("", CUT_OFF)))
    return {
        **(real_time_figures(recording) or {}),
        "episodes": outcomes.total(),
        "outcomes": dict(outcomes),
        "messages": {topic.name.split("/")[-1]: topic.messages for topic in recorded.topics},
        "lost": sum(episode.lost for episode in recorded.episodes),
    }


@contextlib.contextmanager
def busy(count: int) -> Iterator[None]:
    """So many processes that only take time from a processor."""
    running = [subprocess.Popen([sys.executable, "-c", BUSY]) for _ in range(count)]
    try:
        yield
    finally:
        for process in running:
            process.kill()
            process.wait()
