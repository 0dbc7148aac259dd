"""Walks through the nodes that end in whatever episode they are: when the time is up, or something has been done."""

import time
from collections.abc import Callable
from typing import Any, TypeVar

from rabbit_bringup.launching.walk import Graph, WalkOptions, run_graph
from rabbit_cli.executables import LaunchError

Done = TypeVar("Done")

EPISODES = 10_000  # more than there is time for


class TimeIsUp(Exception):
    """The walk has taken as long as it was to."""


def walk_for(graph: Graph, request: WalkOptions, seconds: float, glance: Callable[[Any, float], object]) -> None:
    """Walk for so many s of the wall clock; `glance` gets the watch's `Progress` and the s so far.

    Raises:
        LaunchError: a node cannot be started, ended by itself, or is not ready in time.
        Interrupted: by a signal.
    """
    began: list[float] = []

    def look(now: Any) -> None:
        clock = time.monotonic()
        began.append(clock) if not began else None
        glance(now, clock - began[0])
        if clock - began[0] > seconds:
            raise TimeIsUp

    try:
        run_graph(graph, request, look)
    except TimeIsUp:
        return


def do_once(graph: Graph, request: WalkOptions, ticks: int, act: Callable[[], Done]) -> Done:
    """Walk so many ticks at least, then do something while the nodes go on; returns its result.

    Raises:
        LaunchError: as `walk_for`, or all episodes ended before.
    """
    done: list[Done] = []

    def look(now: Any) -> None:
        if now.ticks >= ticks:
            done.append(act())
            raise TimeIsUp

    try:
        run_graph(graph, request, look)
    except TimeIsUp:
        return done[0]
    raise LaunchError(f"all episodes ended before {ticks} ticks")
