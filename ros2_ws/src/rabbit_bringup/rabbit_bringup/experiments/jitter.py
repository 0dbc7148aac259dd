"""Walks in real time, alone and with busy neighbours, as ordinary processes and under SCHED_FIFO.

FOLDER/CASE/      each walk's parameters, logs and recording
FOLDER/jitter.json
"""

import contextlib
import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rabbit_bringup.experiments import provenance
from rabbit_bringup.experiments.assembly import Assembly
from rabbit_bringup.experiments.timed_walk import EPISODES, walk_for
from rabbit_bringup.experiments.timing import real_time_figures
from rabbit_bringup.launching.walk import WalkOptions, make_graph
from rabbit_bringup.recording.contents import contents
from rabbit_bringup.recording.opening import opened

LATE_LIMIT = 0.001  # share of ticks
BUSY = "while True: pass"


@dataclass(frozen=True)
class Case:
    """One walk: so many busy processes beside it; SCHED_FIFO priority of simulator and controller, 0: ordinary."""

    neighbours: int
    priority: int

    @property
    def name(self) -> str:
        """Of its folder."""
        return f"neighbours-{self.neighbours}-priority-{self.priority}"


def jitter(
    assembly: Assembly, folder: Path, cases: list[Case], seconds: float, seed: int, tell: Callable[[str], object]
) -> list[dict[str, Any]]:
    """Walk each case for so many s; its figures, a row a case, are kept in the folder after each.

    Raises:
        LaunchError: a node cannot be started, ended by itself, or is not ready in time.
        Interrupted: by a signal.
    """
    about = {"command": provenance.command(), "commit": provenance.commit(), "versions": provenance.versions()}
    rows: list[dict[str, Any]] = []
    for case in cases:
        rows.append(_walk(assembly, folder / case.name, case, seconds, seed, tell))
        (folder / "jitter.json").write_text(json.dumps({"cases": rows, "seed": seed, **about}, indent=2) + "\n")
    return rows


def _walk(
    assembly: Assembly, folder: Path, case: Case, seconds: float, seed: int, tell: Callable[[str], object]
) -> dict[str, Any]:
    folder.mkdir(parents=True)
    told = {"seed": seed, "episodes": EPISODES, "trainer": False, "real_time": True, "priority": case.priority}
    request = WalkOptions.model_validate(told)
    graph = make_graph(folder, request, assembly.simulation, assembly.controller, assembly.policy)
    load = os.getloadavg()[0]

    def glance(now: Any, so_far: float) -> None:
        tell(f"{case.name}: {so_far:.0f} of {seconds:.0f} s, episode {now.episode}")

    with busy(case.neighbours):
        walk_for(graph, request, seconds, glance)
    return {**vars(case), "load_before": load, "load_after": os.getloadavg()[0], **figures(folder / "recording")}


def figures(recording: Path) -> dict[str, Any]:
    """Of one walk: timing, how its episodes ended, messages lost on the way to the recorder."""
    found = contents(recording)
    ended = [episode.outcome for episode in found.episodes if episode.outcome]
    outcomes = {outcome: ended.count(outcome) for outcome in sorted(set(ended))}
    with opened(recording) as reader:
        counts = {c.topic.split("/")[-1]: c.msgcount for c in reader.connections}
    lost = {topic.name.split("/")[-1]: topic.lost for topic in found.topics if topic.lost}
    return {
        **(real_time_figures(recording) or {}),
        "episodes": len(ended),
        "outcomes": outcomes,
        "messages": counts,
        "lost": lost,
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
