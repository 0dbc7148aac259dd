"""Many seeded runs of one assembly, in this process or spread over processes.

Run i of seed s has the episode seed of the i-th child of SeedSequence(s), and parts of its own that have seen nothing
yet; so it is the same whoever runs it, in whatever order.
"""

import time
from collections.abc import Callable, Iterator, Mapping
from typing import Generic, ParamSpec, TypeVar

import numpy as np
from rabbit_sim.simulation import Simulation
from rabbit_viewer.walk_records import WalkRecords, about_walk
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.scene import ControllerError
from rl_trainer.rollout import Controller as AnyController
from rl_trainer.rollout import Observer, Record, rollout
from rl_trainer.rollout import Simulation as AnySimulation

from rabbit_experiments.assembly import Assembly
from rabbit_experiments.metrics import RunResult, RunTally
from rabbit_experiments.parallel import in_processes

P = ParamSpec("P")
T = TypeVar("T")


class Timed(Generic[P, T]):
    """A function that notes how many seconds each call took."""

    def __init__(self, function: Callable[P, T]) -> None:
        self._function = function
        self.seconds: list[float] = []

    def __call__(self, *args: P.args, **kwargs: P.kwargs) -> T:
        start = time.perf_counter()
        result = self._function(*args, **kwargs)
        self.seconds.append(time.perf_counter() - start)
        return result


class TimedPlant:
    """A simulation whose ticks are timed."""

    def __init__(self, simulation: Simulation) -> None:
        self.reset = simulation.reset
        self.step = Timed(simulation.step)


class TimedController:
    """A controller whose ticks are timed."""

    def __init__(self, controller: Controller) -> None:
        self.reset = controller.reset
        self.step = Timed(controller.step)


def episode_seeds(seed: int, runs: int) -> dict[int, int]:
    """Episode seed of each run, by its number from 0."""
    children = np.random.SeedSequence(seed).spawn(runs)
    return {run: int(child.generate_state(1)[0]) for run, child in enumerate(children)}


def walk(assembly: Assembly, run: int, seed: int, *observers: Observer) -> RunResult:
    """One run from fresh parts; `observers` see every tick."""
    simulation, controller = assembly.build()
    plant, timed = TimedPlant(simulation), TimedController(controller)
    tally = RunTally(run, assembly.controller, lambda: simulation.reading.foot_force)
    start = time.perf_counter()
    try:
        tally.fault = episode(plant, timed, seed, tally, *observers) or tally.fault
    finally:
        simulation.close()
    wall = time.perf_counter() - start
    return tally.result(seed, simulation.outcome, simulation.landings, timed.step.seconds, plant.step.seconds, wall)


def record_walk(assembly: Assembly, seed: int) -> WalkRecords:
    """One run again, with all its ticks."""
    simulation, controller = assembly.build()
    ticks: list[Record] = []
    try:
        fault = episode(simulation, controller, seed, ticks.append)
    finally:
        simulation.close()
    fault = fault or (ticks[-1].output.fault if ticks else "")
    outcome, policy = fault.split(":")[0] or simulation.outcome.value, controller.policy.version
    about = about_walk(assembly.controller, assembly.simulation, policy, seed, outcome)
    return WalkRecords.from_ticks(ticks, simulation.landings, about)


def episode(simulation: AnySimulation, controller: AnyController, seed: int, *observers: Observer) -> str:
    """A rollout that survives a state the controller refuses; returns why it did, or nothing."""
    try:
        rollout(simulation, controller, seed, *observers)
    except (ControllerError, np.linalg.LinAlgError) as error:
        return f"controller error: {error}"
    return ""


def evaluate(assembly: Assembly, seeds: Mapping[int, int], jobs: int = 1) -> Iterator[RunResult]:
    """Walk each run of `seeds` (number to episode seed); yields as they end, in any order if `jobs` is not 1."""
    return in_processes(walk, [(assembly, run, seed) for run, seed in seeds.items()], jobs)
