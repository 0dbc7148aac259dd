"""This workspace against another one that is built, a commit before or after it, in interleaved pairs.

Each round walks once in each of the two: in process by `rabbit evaluate`, then through the nodes, then with trainer and
recorder as well. How often the ticks come is read from the simulator's restart file, so nothing else listens.
"""

import contextlib
import csv
import os
import shlex
import signal
import statistics
import subprocess
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from rabbit_bringup.launching.parameter_file import write_parameters
from rabbit_bringup.launching.processes import ONE_PROCESS, WALKERS
from rabbit_common.executables import LaunchError, Refused, find_executable

WALKED = {"motor_lag": 0.004, "mass_scale": 2.0}  # the plant; controller and policy are rl-cbf-clf-qp
LAW = "rl-cbf-clf-qp"
EVALUATED = {  # figures of runs.csv
    "tick": "tick_ms_p50",
    "tick, p99": "tick_ms_p99",
    "plant tick": "plant_ms_p50",
    "a walk in process": "walk_seconds",
}
LISTENERS = ("trainer", "recorder")
NODES, WITH_LISTENERS, IN_ONE = "nodes", "nodes, with trainer and recorder", "one process"
PATIENCE, LOOK_SECONDS = 120.0, 0.005
STANDS = ("episode", "tick", "clock_ticks", "running")  # the restart file's first numbers


class Workspace:
    """A built checkout: its `ros2_ws/install` is sourced for each process."""

    def __init__(self, root: Path) -> None:
        """Raises `Refused` where none is built."""
        self._install = root.absolute() / "ros2_ws" / "install"
        if not (self._install / "setup.bash").is_file():
            raise Refused(f"--against {root}: expected a checkout that is built, with ros2_ws/install/setup.bash")

    def start(self, name: str, *words: object, log: Path) -> "subprocess.Popen[bytes]":
        """Start one of its executables; raises `LaunchError` where it has none of this name."""
        found = sorted(self._install.glob(f"*/lib/*/{name}"))
        if not found:
            raise LaunchError(f"{self._install} has no executable {name}")
        command = shlex.join([str(found[0]), *map(str, words)])
        known = ("PYTHONPATH", "AMENT_PREFIX_PATH", "CMAKE_PREFIX_PATH", "COLCON_PREFIX_PATH", "LD_LIBRARY_PATH")
        environment = {name: value for name, value in os.environ.items() if name not in known}
        environment |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        with log.open("ab") as file:
            return subprocess.Popen(
                ["bash", "-c", f"source {shlex.quote(str(self._install / 'setup.bash'))} && exec {command}"],
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=file,
                start_new_session=True,
            )


def compare(other: Path, pairs: int, seed: int, say: Callable[[str], object]) -> dict[str, dict[str, float]]:
    """How many times as long a walk takes in the other workspace: median, least and most of each figure.

    Raises:
        LaunchError: it is not built, or a walk fails.
    """
    theirs, ours = Workspace(other), Workspace(find_executable("rabbit_bringup", "rabbit").parents[5])
    ratios: dict[str, list[float]] = {}
    for number in range(pairs):
        say(f"pair {number + 1} of {pairs}")
        before = figures(theirs, seed + number, (NODES, WITH_LISTENERS))
        after = figures(ours, seed + number, (NODES, WITH_LISTENERS, IN_ONE))
        before[IN_ONE] = before[NODES]  # which had to go through nodes
        for name, value in after.items():
            ratios.setdefault(name, []).append(before[name] / value)
    return {name: {"median": statistics.median(r), "least": min(r), "most": max(r)} for name, r in ratios.items()}


def figures(workspace: Workspace, seed: int, ways: Sequence[str]) -> dict[str, float]:
    """Of one walk in process, and one each of these ways; only ratios of them mean something."""
    with TemporaryDirectory() as folder:
        found = evaluated(workspace, seed, Path(folder))
    for way in ways:
        with TemporaryDirectory() as folder:
            found[way] = seconds_a_tick(workspace, seed, Path(folder), way)
    return found


def evaluated(workspace: Workspace, seed: int, folder: Path) -> dict[str, float]:
    """What `rabbit evaluate` says of one run."""
    plant = [word for name, value in WALKED.items() for word in (f"--{name.replace('_', '-')}", value)]
    words = ("evaluate", "--controller", LAW, "--policy", LAW, *plant, "--runs", 1, "--seed", seed, "--out")
    process = workspace.start("rabbit", *words, folder / "run", log=folder / "log")
    if process.wait(PATIENCE):
        raise LaunchError(f"rabbit evaluate failed: {(folder / 'log').read_text(errors='replace')[-300:]}")
    with (folder / "run" / "runs.csv").open(encoding="utf-8", newline="") as file:
        (row,) = csv.DictReader(file)
    return {name: float(row[column]) for name, column in EVALUATED.items()}


def seconds_a_tick(workspace: Workspace, seed: int, folder: Path, way: str) -> float:
    """Of one episode of simulator and controller, each a process or both in one, alone or with those that listen."""
    listeners = LISTENERS if way == WITH_LISTENERS else ()
    parameters: dict[str, dict[str, Any]] = {
        "simulator": {
            **{"seed": seed, "episodes": 1, "memory": str(folder / "memory"), "readers": 1 + len(listeners), **WALKED},
            "trainer": "wait" if listeners else "ignore",
        },
        "controller": {"controller": LAW, "policy": LAW, "swap_at": "tick" if listeners else "never"},
        "trainer": {"policy": LAW, "folder": str(folder / "training")},
        "recorder": {"path": str(folder / "recording")},
    }
    write_parameters(folder / "parameters.yaml", parameters)
    names = (*((ONE_PROCESS,) if way == IN_ONE else WALKERS), *listeners)
    remaps = ("-r", f"__ns:=/bench_{os.getpid()}", "-r", "/clock:=clock")
    words = ("--ros-args", "--params-file", folder / "parameters.yaml", *remaps)
    running: list[subprocess.Popen[bytes]] = []
    with ending(running):
        running += [workspace.start(name, *words, log=folder / f"{name}.log") for name in names]
        return watch(folder / "memory", running)


def watch(memory: Path, running: list["subprocess.Popen[bytes]"]) -> float:
    """Wall seconds a tick, from the first one that is seen to the episode's end."""
    begun, deadline = None, time.monotonic() + PATIENCE
    while True:
        time.sleep(LOOK_SECONDS)
        now = time.perf_counter()
        data = memory.read_bytes() if memory.exists() else b""
        stands = dict(zip(STANDS, np.frombuffer(data[: 8 * len(STANDS)], "<u8").tolist(), strict=False))
        if stands.get("running") and begun is None:
            begun = now, stands["clock_ticks"]
        elif begun is not None and not stands["running"]:
            return (now - begun[0]) / (stands["clock_ticks"] - begun[1])
        if time.monotonic() > deadline or any(process.poll() is not None for process in running):
            raise LaunchError(f"no walk: {memory.parent} has no episode after {PATIENCE:g} s, or a node ended")


@contextlib.contextmanager
def ending(running: list["subprocess.Popen[bytes]"]) -> Iterator[None]:
    """At the end all end, at once if not soon."""
    try:
        yield
    finally:
        for process in running:
            process.send_signal(signal.SIGTERM)
        for process in running:
            try:
                process.wait(15.0)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
