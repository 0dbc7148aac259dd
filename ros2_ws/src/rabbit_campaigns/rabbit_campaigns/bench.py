"""How long a tick takes, as a whole and in parts, on one walk in one process; and the same walk through the nodes.

Two walks, the same: one free, one with the controller's parts timed, in which the rows are made and OSQP and DAQP solve
each programme once more. Wall time says what this machine gives now; CPU time leaves out what it had to wait for.
"""

import time
from collections import defaultdict
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, TypeVar

import numpy as np
from cbf_clf_qp.solvers import make_solver
from cbf_clf_qp.tick import rows_of
from rabbit_bringup.launching.walk import Walk, WalkOptions
from rabbit_description.state import TICK_SECONDS
from rabbit_experiments.assembly import Assembly
from rl_cbf_clf_controller.controller import Controller
from rl_trainer.rollout import Observer, Record, rollout

MEDIAN_LIMIT, P99_LIMIT, REAL_TIME_LIMIT = 0.5, 1.5, 12.0  # ms, ms, times real time
NODES_LIMIT = 5.0  # times real time, through the nodes
TICK, PLANT = "tick: observation to torque", "plant tick"
MODEL, POLICY, ROWS = "model, outputs, quantities", "policy", "rows of the QP"
SOLVE, REST = "solver (wall)", "QP build, checks, output"
WARM_UP = 20  # ticks not counted
T = TypeVar("T")


class StopWatch:
    """Wall and CPU seconds of each call, by name."""

    def __init__(self) -> None:
        self.wall: dict[str, list[float]] = defaultdict(list)
        self.cpu: dict[str, list[float]] = defaultdict(list)

    def time(self, name: str, function: Callable[..., T], *arguments: Any) -> T:
        """Call and time."""
        wall, cpu = time.perf_counter(), time.thread_time()
        result = function(*arguments)
        self.cpu[name].append(time.thread_time() - cpu)
        self.wall[name].append(time.perf_counter() - wall)
        return result

    def watch(self, owner: Any, method: str, name: str) -> None:
        """Time a method where it is called: caches are as they are in a walk."""
        setattr(owner, method, partial(self.time, name, getattr(owner, method)))

    def figures(self, name: str) -> dict[str, float]:
        """Median and p99, ms."""
        figures: dict[str, float] = {}
        for kind, seconds in (("wall", self.wall[name]), ("cpu", self.cpu[name])):
            median, high = np.percentile(np.array(seconds[WARM_UP:] or seconds) * 1e3, [50, 99])
            figures |= {f"{kind}_ms_p50": float(median), f"{kind}_ms_p99": float(high)}
        return figures


def bench(assembly: Assembly, seed: int) -> dict[str, Any]:
    """Times of one walk (`seed`), of its parts, and of the solvers on its programmes."""
    free, parts, solvers = StopWatch(), StopWatch(), StopWatch()
    start = time.perf_counter()
    ticks = _walk(assembly, seed, free, lambda controller: ())
    wall = time.perf_counter() - start
    _walk(assembly, seed, parts, partial(watch_parts, parts, solvers))
    whole = free.figures(TICK)
    factor = ticks * TICK_SECONDS / wall
    return {
        "ticks": ticks,
        TICK: whole,
        PLANT: free.figures(PLANT),
        "parts": {name: parts.figures(name) for name in (MODEL, POLICY, ROWS, SOLVE, REST)},
        "solvers": {name: solvers.figures(name) for name in solvers.wall},
        "real_time_factor": factor,
        "real_time_factor_cpu": ticks * TICK_SECONDS / sum(sum(free.cpu[name]) for name in (TICK, PLANT)),
        "ratios": {
            "tick median / limit": whole["wall_ms_p50"] / MEDIAN_LIMIT,
            "tick p99 / limit": whole["wall_ms_p99"] / P99_LIMIT,
            "real time / limit": factor / REAL_TIME_LIMIT,
        },
        "limits": {"tick_ms_p50": MEDIAN_LIMIT, "tick_ms_p99": P99_LIMIT, "real_time_factor": REAL_TIME_LIMIT},
    }


def _walk(
    assembly: Assembly, seed: int, watch: StopWatch, observers: Callable[[Controller], tuple[Observer, ...]]
) -> int:
    """A walk from fresh parts; returns its ticks."""
    simulation, controller = assembly.build()
    watch.watch(simulation, "step", PLANT)
    watch.watch(controller, "step", TICK)
    try:
        return rollout(simulation, controller, seed, *observers(controller)).tick
    finally:
        simulation.close()


def watch_parts(parts: StopWatch, solvers: StopWatch, controller: Controller) -> tuple[Observer, ...]:
    """Time what a tick consists of; after each tick make its rows once more, and let both solvers answer it."""
    parts.watch(controller, "look", MODEL)
    parts.watch(controller.policy, "estimate", POLICY)
    both = {name: make_solver(name) for name in ("osqp", "daqp")}

    def observe(record: Record) -> None:
        decided = controller.decided
        parts.time(ROWS, rows_of, controller.recipe, controller.terms, decided.estimates, decided.control)
        for name, solver in both.items():
            solvers.time(f"solve by {name.upper()}", solver.solve, decided.qp)
        for seconds in (parts.wall, parts.cpu):  # by the controller's own clock; what is left of the tick
            seconds[SOLVE].append(record.output.solve_seconds)
            seconds[REST].append(seconds[TICK][-1] - sum(seconds[name][-1] for name in (MODEL, POLICY, ROWS, SOLVE)))

    return (observe,)


def bench_nodes(assembly: Assembly, seed: int) -> dict[str, Any] | None:
    """Ticks and wall seconds of a walk of simulator and controller; None without ROS, or with the oracle.

    Raises:
        LaunchError: a node cannot be started, ended by itself, or is not ready in time.
    """
    if find_spec("rclpy") is None or assembly.policy == "oracle":
        return None
    from rabbit_bringup.ros.walking import walk_through

    options = WalkOptions.model_validate({"seed": seed, "trainer": False, "record": "none"})
    with TemporaryDirectory() as folder:
        walked = walk_through(Walk.of(assembly, Path(folder), options))
    ticks = sum(int(episode.tick) for episode in walked.ended.values())
    factor = ticks * TICK_SECONDS / walked.seconds
    return {"ticks": ticks, "wall_seconds": walked.seconds, "real_time_factor": factor, "ratio": factor / NODES_LIMIT}
