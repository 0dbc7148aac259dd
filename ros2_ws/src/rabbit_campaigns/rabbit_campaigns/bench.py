"""How long a tick takes, as a whole and in parts, on one walk in one process.

Three walks, the same: one free, one with the controller's parts timed, one in which OSQP and DAQP solve each programme
again. Wall time says what this machine gives now; CPU time leaves out what it had to wait for.
"""

import time
from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, TypeVar

import numpy as np
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.solvers import make_solver
from cbf_clf_qp.tick import Terms, rows_of
from rabbit_description.state import TICK_SECONDS
from rabbit_experiments.assembly import Assembly
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.policy import Policy
from rl_cbf_clf_controller.scene import Scene
from rl_trainer.rollout import Observer, Record, rollout

MEDIAN_LIMIT, P99_LIMIT, REAL_TIME_LIMIT = 0.5, 1.5, 12.0  # ms, ms, times real time
TICK, PLANT = "tick: observation to torque", "plant tick"
MODEL, POLICY, ROWS = "model, outputs, quantities", "policy", "rows of the QP"
SOLVE, REST = "solver (wall)", "QP build, checks, output"
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


class WatchedPolicy(Policy):
    """A policy whose forward pass is timed."""

    def __init__(self, policy: Policy, watch: StopWatch) -> None:
        self.version, self.adaptation = policy.version, policy.adaptation
        self._policy, self._watch = policy, watch

    def estimate(self, terms: Terms[Scene], before: Estimates) -> Estimates:
        """The policy's own."""
        return self._watch.time(POLICY, lambda: self._policy.estimate(terms, before))


def watch_parts(controller: Controller, watch: StopWatch) -> None:
    """Time what the controller's own tick calls, where it calls it: caches are as they are in a walk."""
    controller.policy = WatchedPolicy(controller.policy, watch)
    look = controller.look
    setattr(controller, "look", lambda state: watch.time(MODEL, lambda: look(state)))  # noqa: B010, mypy


def rows_once_more(controller: Controller, watch: StopWatch) -> Observer:
    """Observes a walk; the rows of each tick are made once more, and timed."""

    def observe(record: Record) -> None:
        terms, decided = controller.terms, controller.decided
        watch.time(ROWS, lambda: rows_of(controller.recipe, terms, decided.estimates, decided.control))

    return observe


class SolverDuel:
    """Observes a walk; both solvers answer each tick's programme once more."""

    def __init__(self, assembly: Assembly, watch: StopWatch) -> None:
        simulation, self._controller = assembly.build()
        simulation.close()
        self._solvers = {name: make_solver(name) for name in ("osqp", "daqp")}
        self._watch = watch

    def __call__(self, record: Record) -> None:
        controller = self._controller
        controller.step(record.state)
        for name, solver in self._solvers.items():
            self._watch.time(f"solve by {name.upper()}", partial(solver.solve, controller.decided.qp))


def bench(assembly: Assembly, seed: int) -> dict[str, Any]:
    """Times of one walk (`seed`), of its parts, and of the solvers on its programmes."""
    free, parts, duel = StopWatch(), StopWatch(), StopWatch()
    start = time.perf_counter()
    ticks = _walk(assembly, seed, free)
    wall = time.perf_counter() - start
    _walk(assembly, seed, parts, with_parts=True)
    _walk(assembly, seed, StopWatch(), SolverDuel(assembly, duel))
    whole = free.figures(TICK)
    factor = ticks * TICK_SECONDS / wall
    return {
        "ticks": ticks,
        TICK: whole,
        PLANT: free.figures(PLANT),
        "parts": {name: parts.figures(name) for name in (MODEL, POLICY, ROWS, SOLVE, REST)},
        "solvers": {name: duel.figures(name) for name in duel.wall},
        "real_time_factor": factor,
        "real_time_factor_cpu": ticks * TICK_SECONDS / sum(sum(free.cpu[name]) for name in (TICK, PLANT)),
        "ratios": {
            "tick median / limit": whole["wall_ms_p50"] / MEDIAN_LIMIT,
            "tick p99 / limit": whole["wall_ms_p99"] / P99_LIMIT,
            "real time / limit": factor / REAL_TIME_LIMIT,
        },
        "limits": {"tick_ms_p50": MEDIAN_LIMIT, "tick_ms_p99": P99_LIMIT, "real_time_factor": REAL_TIME_LIMIT},
    }


def _walk(assembly: Assembly, seed: int, watch: StopWatch, *observers: Observer, with_parts: bool = False) -> int:
    """A walk from fresh parts; returns its ticks."""
    simulation, controller = assembly.build()
    solves: list[float] = []
    if with_parts:
        watch_parts(controller, watch)
        observers = (*observers, rows_once_more(controller, watch))
    plant, watched = WatchedPart(simulation, watch, PLANT), WatchedPart(controller, watch, TICK)
    try:
        last = rollout(plant, watched, seed, lambda record: solves.append(record.output.solve_seconds), *observers)
    finally:
        simulation.close()
    if with_parts:
        _add_rest(watch, solves)
    return last.tick


def _add_rest(watch: StopWatch, solves: list[float]) -> None:
    """What the controller's own clock says of the solver, and what is left of each tick."""
    for seconds, measured in ((watch.wall, solves), (watch.cpu, solves)):
        seconds[SOLVE] = measured
        known = np.sum([seconds[name] for name in (MODEL, POLICY, ROWS, SOLVE)], axis=0)
        seconds[REST] = (np.array(seconds[TICK]) - known).tolist()
