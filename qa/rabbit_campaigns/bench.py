"""How fast a walk is, each figure against its floor, measured in the same run: only ratios count on a busy machine.

tick                    the tick's CasADi functions, OSQP's own run time and the actor's three products
plant tick              ten bare steps of the engine, in the same world
evaluation              the engine alone, which would take only these ten steps a tick
"""

import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from functools import partial
from typing import Any, TypeVar
from unittest.mock import patch

import numpy as np
from cbf_clf_qp import answer
from cbf_clf_qp.functions import NumpyFunction
from rabbit_description.state import TICK_SECONDS
from rabbit_experiments.assembly import Assembly
from rabbit_sim.plant import SUBSTEPS
from rl_trainer.rollout import Record, rollout
from scipy.linalg.blas import dgemv

TICK, PLANT = "tick: observation to torque", "plant tick"
TERMS, SOLVER, PRODUCTS = "the tick's functions", "OSQP's own run time", "the actor's three products"
ENGINE = "ten bare steps of the engine"
WARM_UP = 20  # ticks not counted
BARE_EVERY = 10  # ticks between two measures of the bare engine
T = TypeVar("T")


class StopWatch:
    """Seconds by the wall clock, by name; those of one tick are summed up."""

    def __init__(self) -> None:
        self.seconds: dict[str, list[float]] = defaultdict(list)
        self._tick: dict[str, float] = defaultdict(float)

    def time(self, name: str, function: Callable[..., T], *arguments: Any) -> T:
        """Call and time."""
        start = time.perf_counter()
        result = function(*arguments)
        self._tick[name] += time.perf_counter() - start
        return result

    def add(self, name: str, seconds: float) -> None:
        """What something else has timed."""
        self._tick[name] += seconds

    def end_tick(self) -> None:
        """What follows belongs to the next tick."""
        for name, seconds in self._tick.items():
            self.seconds[name].append(seconds)
        self._tick.clear()

    @property
    def figures(self) -> dict[str, dict[str, float]]:
        """Median and p99 of each, microseconds."""
        return {name: quantiles(seconds[WARM_UP:] or seconds) for name, seconds in self.seconds.items()}


def quantiles(seconds: list[float]) -> dict[str, float]:
    """Median and p99, microseconds."""
    median, high = np.percentile(np.array(seconds) * 1e6, [50, 99])
    return {"p50": float(median), "p99": float(high)}


def bench(assembly: Assembly, seed: int) -> dict[str, Any]:
    """One walk of this seed in process, free; the same with the floors timed; then the ratios of the two."""
    free, floors = StopWatch(), StopWatch()
    start = time.perf_counter()
    ticks = walk(assembly, seed, free)
    wall = time.perf_counter() - start
    with floors_timed(floors):
        walk(assembly, seed, floors, with_floors=True)
    figures = {**free.figures, **floors.figures}
    parts = [figures[name]["p50"] for name in (TERMS, SOLVER, PRODUCTS) if name in figures]
    tick = figures[TICK]
    ratios = {"tick / its floor": tick["p50"] / sum(parts), "tick, p99 / median": tick["p99"] / tick["p50"]}
    if ENGINE in figures:
        bare = figures[ENGINE]["p50"]
        ratios["plant tick / ten bare steps"] = figures[PLANT]["p50"] / bare
        ratios["evaluation / the bare engine's rate"] = ticks * bare * 1e-6 / wall
    return {"ticks": ticks, "us": figures, "real_time_factor": ticks * TICK_SECONDS / wall, "ratios": ratios}


def walk(assembly: Assembly, seed: int, watch: StopWatch, with_floors: bool = False) -> int:
    """A walk from fresh parts; returns its ticks."""
    simulation, controller = assembly.build()
    layers = actor_layers(controller.policy) if with_floors else []
    steps = bare_steps(simulation.plant) if with_floors else None

    def observe(record: Record) -> None:
        for weights, given in layers:
            watch.time(PRODUCTS, dgemv, 1.0, weights, given, 0.0, None, 0, 1, 0, 1, 1)  # transposed
        if steps is not None and record.state.tick % BARE_EVERY == 0:
            steps(watch)
        if with_floors and assembly.controller.qp_solver == "osqp":
            watch.add(SOLVER, 0.0)  # it is not asked in every tick
        watch.end_tick()

    if not with_floors:
        parts: tuple[tuple[Any, str], ...] = ((simulation, PLANT), (controller, TICK))
        for part, name in parts:
            part.step = partial(watch.time, name, part.step)
    with closing(simulation):
        return rollout(simulation, controller, seed, observe).tick


@contextmanager
def floors_timed(watch: StopWatch) -> Iterator[None]:
    """Meanwhile CasADi's evaluation and OSQP's own code are timed where Python calls them. DAQP is in a function."""
    solve, call = answer.OsqpSolver.solve, NumpyFunction.__call__

    def solve_and_ask(solver: Any, *given: Any) -> Any:
        x, y, status = solve(solver, *given)
        watch.add(SOLVER, 0.0 if status == "unconstrained" else solver._solver.info.run_time)
        return x, y, status

    def call_and_repeat(function: NumpyFunction, *given: Any) -> Any:
        found = call(function, *given)
        watch.time(TERMS, function.evaluate)  # with the same arguments
        return found

    with (
        patch.object(NumpyFunction, "__call__", call_and_repeat),
        patch.object(answer.OsqpSolver, "solve", solve_and_ask),
    ):
        yield


def actor_layers(policy: Any) -> list[tuple[Any, Any]]:
    """The weights of a policy's three layers, each with something to multiply; none without an actor."""
    arrays = getattr(getattr(policy, "file", None), "arrays", {})
    weights = [arrays[f"{layer}.weight"].astype(float).T for layer in "012"] if arrays else []
    return [(each, np.ones(each.shape[0])) for each in weights]


def bare_steps(plant: Any) -> Callable[[StopWatch], None] | None:
    """What times ten bare steps from where the plant stands, and puts it back; None but for PyBullet."""
    client = getattr(plant, "_client", None)
    if client is None:
        return None

    def steps(watch: StopWatch) -> None:
        state = client.saveState()
        watch.time(ENGINE, lambda: [client.stepSimulation() for _ in range(SUBSTEPS)])
        client.restoreState(state)
        client.removeState(state)

    return steps
