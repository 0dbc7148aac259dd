"""Walks in real time, alone and with busy neighbours, as ordinary processes and under SCHED_FIFO; dying controllers.

FOLDER/CASE/                  each walk's parameters, logs and recording
FOLDER/kill-K-priority-P/     the same of a walk whose controller is killed
FOLDER/jitter.json
"""

import contextlib
import os
import random
import subprocess
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from rabbit_bringup.launching.walk import MOST_EPISODES, WalkOptions, WalkSettings
from rabbit_experiments.assembly import Assembly
from rabbit_recording.contents import contents
from rabbit_recording.timing import real_time_figures

from rabbit_campaigns.figures import write_figures

LATE_LIMIT = 0.001  # share of ticks
CUT_OFF = "reset"  # outcome of the episode in which the time was up
BUSY = "while True: pass"


class Jitter:
    """Walks of one plant and controller, under `folder`; `tell` hears how far they are. What is found is kept at once.

    All methods raise:
        LaunchError: a node cannot be started, ended by itself, or is not ready in time.
        Interrupted: by a signal.
    """

    def __init__(self, assembly: Assembly, folder: Path, seed: int, tell: Callable[[str], object]) -> None:
        self._assembly, self._folder, self._seed, self._tell = assembly, folder, seed, tell
        self.cases: list[dict[str, Any]] = []
        self.deaths: list[dict[str, Any]] = []

    def walk(self, neighbours: int, priority: int, seconds: float) -> None:
        """Walk for so many s beside so many busy processes; SCHED_FIFO `priority` of simulator and controller, or 0."""
        from rabbit_bringup.ros.walking import walking

        name = f"neighbours-{neighbours}-priority-{priority}"
        walk, load = self._prepared(name, priority), os.getloadavg()[0]
        with busy(neighbours), walking(walk) as monitor:
            began = time.monotonic()
            while (so_far := time.monotonic() - began) < seconds:
                self._tell(f"{name}: {so_far:.0f} of {seconds:.0f} s, episode {monitor.glance().episode}")
        about = {"neighbours": neighbours, "priority": priority, "load_before": load, "load_after": os.getloadavg()[0]}
        self.cases.append({**about, **figures(walk.folder / "recording")})
        self._keep()

    def kill(self, number: int, priority: int) -> None:
        """Walk until the controller is killed, and tell how soon the joints are damped."""
        from rabbit_campaigns.ros.kill_controller import die

        name = f"kill-{number}-priority-{priority}"
        self._tell(name)
        self.deaths.append({"priority": priority, **vars(die(self._prepared(name, priority), random.Random(number)))})
        self._keep()

    def _prepared(self, name: str, priority: int) -> WalkSettings:
        (self._folder / name).mkdir(parents=True)
        many: dict[str, Any] = {"seed": self._seed, "episodes": MOST_EPISODES, "priority": priority}
        options = WalkOptions(**many, trainer=False, real_time=True)
        return WalkSettings.of(self._assembly, self._folder / name, options)

    def _keep(self) -> None:
        found = {"cases": self.cases, "deaths": self.deaths, "seed": self._seed}
        write_figures(self._folder / "jitter.json", found)


def figures(recording: Path) -> dict[str, Any]:
    """Of one walk: timing, how its episodes ended, ticks lost on the way to the recorder."""
    found = contents(recording)
    outcomes = Counter(sorted(episode.outcome for episode in found.episodes if episode.outcome not in ("", CUT_OFF)))
    return {
        **(real_time_figures(recording) or {}),
        "episodes": outcomes.total(),
        "outcomes": dict(outcomes),
        "messages": {topic.name.split("/")[-1]: topic.messages for topic in found.topics},
        "lost": sum(episode.lost for episode in found.episodes),
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
