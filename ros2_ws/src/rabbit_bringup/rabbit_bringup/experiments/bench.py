"""How long a tick takes, as a whole and in parts, on one walk in one process.

Each part is timed again at every state of the walk, right after the tick itself; OSQP and DAQP solve the same
programmes. Wall time says what this machine gives now; CPU time what it would give if nothing else ran.
"""

import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, TypeVar

import numpy as np
from rabbit_description.state import TICK_SECONDS
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.qp import build_qp, unpack
from rl_cbf_clf_controller.solvers import make_solver
from rl_trainer.rollout import Record, rollout

from rabbit_bringup.experiments.assembly import Assembly

MEDIAN_LIMIT, P99_LIMIT, REAL_TIME_LIMIT = 0.5, 1.5, 12.0  # ms, ms, times real time
TICK, PLANT = "tick: observation to torque", "plant tick"
WARM_UP = 20  # ticks not counted
T = TypeVar("T")


@dataclass
class StopWatch:
    """Wall and CPU seconds of each call, by name."""

    wall: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))
    cpu: dict[str, list[float]] = field(default_factory=lambda: defaultdict(list))

    def time(self, name: str, function: Callable[[], T]) -> T:
        """Call and time."""
        wall, cpu = time.perf_counter(), time.thread_time()
        result = function()
        self.cpu[name].append(time.thread_time() - cpu)
        self.wall[name].append(time.perf_counter() - wall)
        return result

    def figures(self, name: str) -> dict[str, float]:
        """Median and p99, ms."""
        figures: dict[str, float] = {}
        for kind, seconds in (("wall", self.wall[name]), ("cpu", self.cpu[name])):
            median, high = np.percentile(np.array(seconds[WARM_UP:] or seconds) * 1e3, [50, 99])
            figures |= {f"{kind}_ms_p50": float(median), f"{kind}_ms_p99": float(high)}
        return figures


class WatchedPart:
    """Plant or controller whose `step` is timed."""

    def __init__(self, part: Any, watch: StopWatch, name: str) -> None:
        self.reset = part.reset
        self.step = lambda given: watch.time(name, lambda: part.step(given))


class Parts:
    """Observes a walk and times the parts of each tick again."""

    def __init__(self, controller: Controller, watch: StopWatch) -> None:
        self._controller, self._watch = controller, watch
        self._osqp, self._daqp = make_solver("osqp"), make_solver("daqp")

    def __call__(self, record: Record) -> None:
        controller, time_of = self._controller, self._watch.time
        terms = time_of("model, outputs, quantities", lambda: controller.terms(record.state))
        estimates = time_of("policy", lambda: controller.policy.estimate(terms.context))
        rows = time_of("rows", lambda: controller.rows(terms, estimates, terms.precontrol))
        qp = time_of("QP build", lambda: build_qp(rows))
        time_of("solve by OSQP", lambda: self._osqp.solve(qp))
        solution = time_of("solve by DAQP", lambda: self._daqp.solve(qp))
        time_of("unpack", lambda: unpack(qp, solution.x))


def bench(assembly: Assembly, seed: int) -> dict[str, Any]:
    """Times of one walk (`seed`) with parts, and of the same walk without."""
    watch, free = StopWatch(), StopWatch()
    ticks = _walk(assembly, seed, watch, with_parts=True)
    start = time.perf_counter()
    _walk(assembly, seed, free, with_parts=False)
    wall = time.perf_counter() - start
    whole = free.figures(TICK)
    factor = ticks * TICK_SECONDS / wall
    return {
        "ticks": ticks,
        TICK: whole,
        PLANT: free.figures(PLANT),
        "parts": {name: watch.figures(name) for name in watch.wall if name not in (TICK, PLANT)},
        "real_time_factor": factor,
        "real_time_factor_cpu": ticks * TICK_SECONDS / sum(sum(free.cpu[name]) for name in (TICK, PLANT)),
        "ratios": {
            "tick median / limit": whole["wall_ms_p50"] / MEDIAN_LIMIT,
            "tick p99 / limit": whole["wall_ms_p99"] / P99_LIMIT,
            "real time / limit": factor / REAL_TIME_LIMIT,
        },
        "limits": {"tick_ms_p50": MEDIAN_LIMIT, "tick_ms_p99": P99_LIMIT, "real_time_factor": REAL_TIME_LIMIT},
    }


def _walk(assembly: Assembly, seed: int, watch: StopWatch, with_parts: bool) -> int:
    """A walk from fresh parts; returns its ticks."""
    simulation, controller = assembly.build()
    observers = [Parts(controller, watch)] if with_parts else []
    try:
        last = rollout(WatchedPart(simulation, watch, PLANT), WatchedPart(controller, watch, TICK), seed, *observers)
    finally:
        simulation.close()
    return last.tick
