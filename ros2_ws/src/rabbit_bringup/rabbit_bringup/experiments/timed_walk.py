"""A walk through the nodes that ends when its time is up, in whatever episode it is."""

import time
from collections.abc import Callable
from typing import Any

from rabbit_bringup.launching.walk import Graph, WalkOptions, run_graph

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
