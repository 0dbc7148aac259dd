"""What the live view costs, and how soon it is there.

The cost: the same walk through the nodes without and with a viewer that a client watches, in pairs.

By the wall clock, and by the processor time that simulator and controller, who alternate in lock-step, need for a tick:
the viewer itself has another core, and other work on the machine does not count. The two walks of a pair follow each
other, every other pair in the other order, since the machine's speed drifts.

The start: beside a graph that walks in real time's pace, from the viewer's start until a client has a first message.
"""

import contextlib
import multiprocessing
import statistics
import time
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from rabbit_bringup.launching.processes import Processes
from rabbit_bringup.launching.walk import WalkOptions, make_graph, run_graph
from rabbit_description.state import TICK_SECONDS
from rabbit_experiments.assembly import Assembly
from rabbit_viewer.live.client import Listener

from rabbit_campaigns.node_usage import node_processes, usage
from rabbit_campaigns.timed_walk import do_once

EPISODES = 3  # of a walk
PORT = 8766  # not the default one: somebody may be looking there
READY_SECONDS = 60.0
COST_LIMIT = 0.10
START_LIMIT = 1.0  # s
STARTS = 5
EARLIEST = 20  # ticks walked before a viewer is started
WALKERS = ("simulator", "controller")


@dataclass
class Walk:
    """What one walk took."""

    ticks: int = 0
    seconds: float = 0.0
    messages: int = 0
    first: dict[str, float] = field(default_factory=dict)  # CPU s by node, at its first glance
    last: dict[str, float] = field(default_factory=dict)

    @property
    def factor(self) -> float:
        """Times real time."""
        return self.ticks * TICK_SECONDS / self.seconds

    @property
    def cpu_ms(self) -> float:
        """Of the walkers, a tick."""
        return sum(self.last[name] - self.first[name] for name in WALKERS) / self.ticks * 1e3


def bench_view(assembly: Assembly, seed: int, pairs: int) -> dict[str, Any]:
    """Figures of each walk, and medians over the pairs of what the view takes off the rate.

    Raises:
        LaunchError: a node cannot be started, ended by itself, or is not ready in time.
    """
    without: list[Walk] = []
    watched: list[Walk] = []
    for pair in range(pairs):
        for view in (False, True) if pair % 2 == 0 else (True, False):
            (watched if view else without).append(_walk(assembly, seed, view))
    costs = [1 - b.factor / a.factor for a, b in zip(without, watched, strict=True)]
    costs_cpu = [1 - a.cpu_ms / b.cpu_ms for a, b in zip(without, watched, strict=True)]
    shares = [(walk.last["viewer"] - walk.first["viewer"]) / walk.seconds for walk in watched]
    return {
        **{f"factor_{name}": [walk.factor for walk in walks] for name, walks in _named(without, watched)},
        **{f"cpu_ms_{name}": [walk.cpu_ms for walk in walks] for name, walks in _named(without, watched)},
        "viewer_cpu_share": shares,
        "messages": [walk.messages for walk in watched],
        "costs": costs,
        "costs_cpu": costs_cpu,
        "cost": statistics.median(costs),
        "cost_cpu": statistics.median(costs_cpu),
        "limit": COST_LIMIT,
        "start_seconds": [_start(assembly, seed) for _ in range(STARTS)],
        "start_limit": START_LIMIT,
    }


def _named(without: list[Walk], watched: list[Walk]) -> tuple[tuple[str, list[Walk]], ...]:
    return (("without", without), ("watched", watched))


def _walk(assembly: Assembly, seed: int, view: bool) -> Walk:
    told = {"seed": seed, "episodes": EPISODES, "trainer": False, "record": "none", "pace": 0.0}
    options = WalkOptions.model_validate({**told, "view": view, "view_port": PORT})
    context = multiprocessing.get_context("spawn")
    heard = context.Value("i", 0)
    client = context.Process(target=_watch, args=(heard,), daemon=True)
    walk = Walk()
    if view:
        client.start()
    with TemporaryDirectory() as folder:
        graph = make_graph(Path(folder), options, assembly.simulation, assembly.controller, assembly.policy)

        def glance(_: Any) -> None:
            walk.last = cpu_seconds(Path(folder), graph.names)
            walk.first = walk.first or walk.last

        ended, walk.seconds = run_graph(graph, options, glance)
    if view:
        client.join()
    walk.ticks, walk.messages = sum(int(episode.tick) for episode in ended), heard.value
    return walk


def _start(assembly: Assembly, seed: int) -> float:
    told = {"seed": seed, "trainer": False, "record": "none", "pace": 1.0, "view": True, "view_port": PORT}
    options = WalkOptions.model_validate(told)
    with TemporaryDirectory() as folder:
        graph = make_graph(Path(folder), options, assembly.simulation, assembly.controller, assembly.policy)
        viewer = graph.nodes.pop("viewer")

        def look() -> float:
            processes, began = Processes(Path(folder) / "viewer"), time.monotonic()
            try:
                processes.start(viewer)
                with Listener(f"ws://127.0.0.1:{PORT}", READY_SECONDS) as listener:
                    while listener.hear(0.1) is None:
                        processes.check()
                return time.monotonic() - began
            finally:
                processes.stop()

        return do_once(graph, options, EARLIEST, look)


def cpu_seconds(folder: Path, names: list[str]) -> dict[str, float]:
    """Processor time that the graph in `folder` has used so far, by node."""
    used = {}
    for name, process in node_processes(folder, names).items():
        with contextlib.suppress(OSError):  # it has ended
            used[name] = usage(process).cpu
    return used


def _watch(heard: Any) -> None:
    """Take all that the view sends, until it ends."""
    with Listener(f"ws://127.0.0.1:{PORT}", READY_SECONDS) as listener:
        while not listener.has_ended:
            heard.value += listener.hear(0.5) is not None
