"""A long walk with learning, swapping, recording and an operator on: does anything grow, leak, slow down or fall?

FOLDER/samples.csv       every few seconds: ticks so far, load, and of each node memory, descriptors, threads, CPU time
FOLDER/operations.csv    what the operator did (`soak_operations`)
FOLDER/soak.json         what follows from them, with the bars

What counts begins after a warm-up. Memory, descriptors and threads: the medians of the first and the last tenth of it.
The rate: simulator's and controller's processor time a tick, by Theil and Sen's slope over the whole of it, since other
work on the machine moves single stretches by more than the bar.
"""

import csv
import os
import time
from collections.abc import Mapping
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rabbit_bringup.launching.walk import WalkSettings
from scipy.optimize import nnls
from scipy.stats import theilslopes

from rabbit_campaigns.figures import ShowStatus
from rabbit_campaigns.soak_operations import Operations, unfit_policy

EVERY = 5.0  # s between samples
WARM_UP = 300.0  # s, a third of shorter soaks
WINDOWS, STRETCHES = 10, 30
GROWTH_LIMIT, DRIFT_LIMIT = 0.02, 0.05
LAUNCHER = "launcher"  # this process
WALKERS = ("simulator", "controller")
SAMPLES = "samples.csv"
USAGE = ("memory", "descriptors", "threads", "cpu")  # of each node: MB, numbers, s of processor time since it began
KILOBYTES_PER_MB = 1024

Samples = Mapping[str, NDArray[np.float64]]


def soak(walk: WalkSettings, seconds: float, show_status: ShowStatus, operate_every: float) -> None:
    """Walk for so many s and leave a sample every few; s between two operations, 0 for none.

    Raises:
        LaunchError: a node cannot be started, ended by itself, or is not ready in time.
        ValueError: no shipped policy is unfit for this controller.
        Interrupted: by a signal.
    """
    from rabbit_bringup.ros.walk_monitor import walking

    from rabbit_campaigns.ros.operator import Operator

    names = [*walk.names, LAUNCHER]
    with ExitStack() as stack:
        file = stack.enter_context((walk.folder / SAMPLES).open("w", newline="", encoding="utf-8", buffering=1))
        rows = csv.writer(file)
        rows.writerow(["seconds", "ticks", "episode", "load", *(f"{name}_{what}" for name in names for what in USAGE)])
        monitor = stack.enter_context(walking(walk))
        operations, seed = None, walk.options.seed
        if operate_every:
            policies = Path(walk.policy).absolute(), unfit_policy(walk.controller)
            operator = Operator("", walk.folder, policies, walk.options.pace or 0.0, seed, monitor.check)
            operations = stack.enter_context(Operations(operator, walk.folder, operate_every, seed))
        pids = {name: process.pid for name, process in monitor.processes.running.items()} | {LAUNCHER: os.getpid()}
        began, due = time.monotonic(), 0.0
        while (so_far := time.monotonic() - began) < seconds:
            now = monitor.glance()
            if so_far >= due:
                due += EVERY
                used = [number for name in names for number in usage(pids[name])]
                rows.writerow([f"{so_far:.3f}", now.ticks, now.episode, os.getloadavg()[0], *used])
                show_status(f"{so_far / 60:.1f} of {seconds / 60:g} min, {now.ticks} ticks, episode {now.episode}")
            if operations:
                operations(so_far)


def usage(process: int) -> tuple[float, int, int, float]:
    """What a process takes now, as in `USAGE`."""
    home = Path("/proc") / str(process)
    status = dict(line.split(":", 1) for line in (home / "status").read_text().splitlines())
    user, system = (home / "stat").read_text().rpartition(")")[2].split()[11:13]
    memory = int(status["VmRSS"].split()[0]) / KILOBYTES_PER_MB
    cpu = (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")
    return memory, len(list((home / "fd").iterdir())), int(status["Threads"]), cpu


def read_samples(path: Path) -> Samples:
    """The columns, by name."""
    with path.open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    return {name: np.array([float(row[name]) for row in rows]) for name in rows[0]}


def judge(samples: Samples) -> dict[str, Any]:
    """Growth of each node's memory, descriptors and threads and drift of the rate, against the bars."""
    seconds = samples["seconds"]
    first, last = windows(seconds)
    nodes: dict[str, dict[str, Any]] = {}
    for node in (name.removesuffix("_memory") for name in samples if name.endswith("_memory")):
        memory, descriptors, threads = (
            [float(np.median(samples[f"{node}_{what}"][part])) for part in (first, last)] for what in USAGE[:3]
        )
        growth = memory[1] / memory[0] - 1
        nodes[node] = {"memory_mb": memory, "growth": growth, "descriptors": descriptors, "threads": threads}
    cpu_ms, drift = _processor_time(samples)
    rate = [float(np.ptp(samples["ticks"][part]) / max(np.ptp(seconds[part]), 1e-9)) for part in (first, last)]
    bars = {
        "memory": max(node["growth"] for node in nodes.values()) <= GROWTH_LIMIT,
        "descriptors": all(node["descriptors"][1] <= node["descriptors"][0] for node in nodes.values()),
        "threads": all(node["threads"][1] <= node["threads"][0] for node in nodes.values()),
        "rate": drift[0] <= DRIFT_LIMIT,
    }
    return {
        "seconds": float(seconds[-1]),
        "ticks": int(samples["ticks"][-1]),
        "episodes": int(samples["episode"][-1]),
        "load": [float(samples["load"].min()), float(np.median(samples["load"])), float(samples["load"].max())],
        "ticks_per_second": rate,
        "cpu_ms_per_tick": cpu_ms,
        "cpu_drift": drift,
        "nodes": nodes,
        "bars_kept": bars,
    }


def windows(seconds: NDArray[np.float64]) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """The first and the last tenth of what follows the warm-up."""
    begin, end = _counted(seconds)
    width = (end - begin) / WINDOWS
    first: NDArray[np.bool_] = (seconds >= begin) & (seconds <= begin + width)
    first[min(int(np.searchsorted(seconds, begin)), max(len(seconds) - 2, 0))] = True  # a short soak may have no other
    last: NDArray[np.bool_] = seconds >= end - width
    return first, last


def _counted(seconds: NDArray[np.float64]) -> tuple[float, float]:
    """When counting begins and ends, s."""
    end = float(seconds[-1])
    return min(WARM_UP, end / 3), end


def _processor_time(samples: Samples) -> tuple[float, list[float]]:
    """Median time of simulator and controller, ms a tick; its drift from begin to end as a share, with 95% interval.

    processor time = (ms a tick) ticks + (ms a second) seconds: timers and the middleware's leases run by the clock, and
    where other work slows the walk they are more a tick. That part is fitted and taken off before the drift.
    """
    ends = np.searchsorted(samples["seconds"], np.linspace(*_counted(samples["seconds"]), STRETCHES + 1))
    ends = np.unique(np.clip(ends, 0, len(samples["seconds"]) - 1))
    cpu = np.sum([samples[f"{node}_cpu"] for node in WALKERS], axis=0)[ends]
    seconds, ticks = samples["seconds"][ends], samples["ticks"][ends]
    walked = np.diff(ticks) > 0
    used, made, passed = np.diff(cpu)[walked] * 1e3, np.diff(ticks)[walked], np.diff(seconds)[walked]
    (_, by_second), _ = nnls(np.column_stack([made, passed]), used)
    middles = (seconds[1:] + seconds[:-1])[walked] / 2
    slope, _, low, high = theilslopes((used - by_second * passed) / made, middles, 0.95)
    median = float(np.median(used / made))
    return median, [float(value * (seconds[-1] - seconds[0]) / median) for value in (slope, low, high)]
