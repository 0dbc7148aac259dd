"""What `rabbit view` costs a graph: lock-step walks without and with a viewer that somebody watches, in turns.

A pair is the same walk twice. Its ratios, with a viewer over without: simulator's and controller's processor time a
tick, and the rate of ticks by the wall clock. The watcher is a websocket client that takes all and draws nothing.
"""

import os
import re
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rabbit_bringup.launching.processes import WALKERS
from rabbit_bringup.launching.walk import Walk, WalkOptions
from rabbit_bringup.ros.walking import walking
from rabbit_common.executables import LaunchError
from rabbit_experiments.assembly import Assembly
from rabbit_viewer.page.files import SOCKET
from scipy.stats import quantile_test
from websockets.sync.client import connect

from rabbit_campaigns.soak import usage

EPISODES = 1  # of a walk, 1,000 ticks
PROCESSOR, RATE = "processor time a tick", "ticks a second"
INTERVAL = 0.95
FEWEST_LOOKS = 3

Figures = dict[str, float]  # PROCESSOR: s; RATE: 1/s by the wall clock


def measure(assembly: Assembly, seed: int, pairs: int, say: Callable[[str], object]) -> dict[str, Any]:
    """Both ratios: of each pair, their median and the median's interval by order statistics; and the load before.

    Pairs begin in turns with the one and the other walk.

    Raises:
        LaunchError: a node cannot be started, ended by itself, or is not ready in time.
    """
    load = os.getloadavg()[0]
    ratios: dict[str, list[float]] = {PROCESSOR: [], RATE: []}
    for number in range(pairs):
        order = (False, True) if number % 2 == 0 else (True, False)
        walked = {is_viewed: walk(assembly, seed + number * EPISODES, is_viewed) for is_viewed in order}
        for name, its in ratios.items():
            its.append(walked[True][name] / walked[False][name])
        told = ", ".join(f"{name} times {its[-1]:.3f}" for name, its in ratios.items())
        say(f"pair {number + 1} of {pairs}: {told}")
    return {"load": load, "ratios": {name: {"pairs": its, **median(its)} for name, its in ratios.items()}}


def median(values: list[float]) -> dict[str, Any]:
    """With its interval, None where the values are too few for one."""
    interval = quantile_test(values, p=0.5).confidence_interval(INTERVAL)
    ends = [float(end) for end in (interval.low, interval.high)]
    return {"median": float(np.median(values)), "interval": ends if np.isfinite(ends).all() else None}


def walk(assembly: Assembly, seed: int, is_viewed: bool) -> Figures:
    """From the first look at the walk to the last before its end; raises `LaunchError`."""
    options = WalkOptions(
        **{"seed": seed, "episodes": EPISODES, "trainer": False, "record": "none", "pace": 0.0},
        **{"view": is_viewed, "view_port": 0, "namespace": f"bench_{os.getpid()}"},
    )
    with TemporaryDirectory() as name, walking(Walk.of(assembly, folder := Path(name), options)) as monitor:
        pids = [monitor.processes.pid(each) for each in WALKERS]
        looks: list[tuple[float, float, float]] = []
        with watched(folder / "log" / "viewer.log") if is_viewed else nullcontext():
            while not monitor.is_over:
                ticks = monitor.glance().ticks
                looks.append((time.monotonic(), ticks, sum(usage(pid)[-1] for pid in pids)))
    if len(looks) < FEWEST_LOOKS:
        raise LaunchError("the walk is too short to be measured; give it more stones")
    seconds, ticks, processor = np.subtract(looks[-2], looks[0])  # the last one may be after the end
    return {PROCESSOR: processor / ticks, RATE: ticks / seconds}


@contextmanager
def watched(log: Path) -> Iterator[None]:
    """Meanwhile a client takes all that the viewer of this log serves."""
    (address,) = re.findall(r"http://[\d.:]+", log.read_text(encoding="utf-8"))
    with connect(address.replace("http", "ws", 1) + SOCKET, compression=None, max_size=None) as socket:
        threading.Thread(target=take_all, args=(socket,)).start()
        yield


def take_all(socket: Any) -> None:
    """Until one of the two ends closes it."""
    for _ in socket:
        pass
