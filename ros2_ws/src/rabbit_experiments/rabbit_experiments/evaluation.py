"""Seeded runs of one assembly: a run, its figures, all its ticks; a scenario is many of them.

Run i of seed s has the episode seed of the i-th child of SeedSequence(s). A reset brings plant and controller to where
they began, so a run does not depend on its process or on the runs before it. A process keeps the last assembly's parts.
"""

import atexit
import time
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from rabbit_description.gait import load_gaits
from rabbit_description.state import Array
from rabbit_sim.simulation import Simulation
from rl_cbf_clf_controller.batch_controller import BatchController
from rl_cbf_clf_controller.batch_output import BatchOutput
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.scene import ControllerError
from rl_trainer.rollout import Controller as AnyController
from rl_trainer.rollout import Observer, Record, Shares, rollout, rollout_together
from rl_trainer.rollout import Simulation as AnySimulation

from rabbit_experiments.assembly import Assembly, make_simulation
from rabbit_experiments.cache import Job
from rabbit_experiments.metrics import BatchColumns, RunResult, RunTally
from rabbit_experiments.provenance import named_files, plain
from rabbit_experiments.walk_records import WalkRecords, about_walk, load_records, save_records


class Timed:
    """A plant or a controller; notes how many seconds the steps took."""

    def __init__(self, part: Any) -> None:
        self.reset, self._step = part.reset, part.step
        self.seconds: list[float] = []

    def step(self, argument: Any) -> Any:
        start = time.perf_counter()
        result = self._step(argument)
        self.seconds.append(time.perf_counter() - start)
        return result


def episode_seeds(seed: int, runs: int) -> dict[int, int]:
    """Episode seed of each run, by its number from 0."""
    children = np.random.SeedSequence(seed).spawn(runs)
    return {run: int(child.generate_state(1)[0]) for run, child in enumerate(children)}


_kept: dict[str, tuple[Any, Any]] = {}  # `plant` and `controller` of the last run: what each was made of, and it


@contextmanager
def parts(assembly: Assembly) -> Iterator[tuple[Simulation, Controller]]:
    """Plant and controller to reset and walk with; those of the last run that were made of the same, and its files."""
    files = named_files(plain(assembly))
    plant = assembly.simulation, assembly.controller.gait, files
    others = {**vars(assembly), "simulation": assembly.simulation if assembly.knows_plant else None}
    controlled = type(assembly), others, files
    controller = _kept_or("controller", controlled, assembly.make_controller)
    simulation = _kept_or("plant", plant, assembly.make_simulation)
    try:
        yield simulation, controller
    except BaseException:
        simulation.close()
        raise
    forget_parts()  # of a run within this one
    _kept.update(plant=(plant, simulation), controller=(controlled, controller))


def _kept_or(name: str, of: Any, make: Callable[[], Any]) -> Any:
    """The part that is kept, if it was made of the same; else it is forgotten, and another one made."""
    if name in _kept and _kept[name][0] == of:
        return _kept.pop(name)[1]
    if name == "plant":
        forget_parts()
    return make()


@atexit.register
def forget_parts() -> None:
    """Close what is kept for the next run."""
    if "plant" in _kept:
        _kept["plant"][1].close()
    _kept.clear()


def walk(assembly: Assembly, run: int, seed: int, *observers: Observer) -> RunResult:
    """One run; `observers` see every tick."""
    with parts(assembly) as (simulation, controller):
        plant, timed = Timed(simulation), Timed(controller)
        tally = RunTally(run, assembly.controller)

        def observe(record: Record) -> None:
            tally.observe(record.output, simulation.reading.foot_force)

        start = time.perf_counter()
        tally.fault = episode(plant, timed, seed, observe, *observers) or tally.fault
        wall = time.perf_counter() - start
        return tally.result(seed, simulation.outcome, simulation.landings, timed.seconds, plant.seconds, wall)


def walk_together(
    one: Controller, assemblies: Sequence[Assembly], numbers: Sequence[int], seeds: Sequence[int]
) -> Iterator[tuple[int, RunResult]]:
    """Walks under copies of `one`, of assemblies that differ in their plants alone.

    A run leaves to the bit what it leaves alone, but for the times, which are a robot's share of what all of them took.
    `numbers` of the runs, `seeds` of the episodes. Yields place and result of a run as it ends.
    """
    from rabbit_sim.batch_simulation import BatchSimulation  # needs MuJoCo, which not everybody has

    first, gait = assemblies[0], load_gaits(assemblies[0].controller.gait)
    simulation = BatchSimulation([make_simulation(assembly.simulation, gait) for assembly in assemblies])
    policies = [assembly.make_policy() if first.policy == "oracle" else one.policy for assembly in assemblies]
    columns, shares = BatchColumns(one), Shares()
    tallies = [RunTally(run, first.controller) for run in numbers]

    def observe(places: Array, output: BatchOutput) -> None:
        rows = columns.of_all(output, simulation.true_force)
        for row, place in enumerate(places.tolist()):
            if row not in output.errors:
                tallies[place].add(rows[row], columns)

    for ended in rollout_together(simulation, BatchController(one, policies), seeds, observe, shares):
        place, robot, tally = ended.place, ended.simulation, tallies[ended.place]
        tally.fault = ended.fault  # all runs began with the first tick, so all shares are this one's
        times = [*shares.controller], [*shares.plant], sum(shares.whole)
        yield place, tally.result(seeds[place], robot.outcome, robot.landings, *times)
        robot.close()


def record_walk(assembly: Assembly, seed: int) -> WalkRecords:
    """One run again, with all its ticks."""
    ticks: list[Record] = []
    with parts(assembly) as (simulation, controller):
        fault = episode(simulation, controller, seed, ticks.append)
        outcome, policy = ended(simulation, fault, ticks), controller.policy.version
        about = about_walk(assembly.controller, assembly.simulation, policy, seed, outcome)
        return WalkRecords.from_ticks(ticks, simulation.landings, about)


def episode(simulation: AnySimulation, controller: AnyController, seed: int, *observers: Observer) -> str:
    """A rollout that survives a state the controller refuses; returns why it did, or nothing."""
    try:
        rollout(simulation, controller, seed, *observers)
    except (ControllerError, np.linalg.LinAlgError) as error:
        return f"controller error: {error}"
    return ""


def ended(simulation: Simulation, fault: str, ticks: list[Record]) -> str:
    """How an episode ended: by its fault or its last tick's, by the name before the colon, or as the plant says."""
    fault = fault or (ticks[-1].output.fault if ticks else "")
    return fault.split(":")[0] or simulation.outcome.value


@dataclass(frozen=True)
class SeededRun(Job):
    """A run of an assembly from an episode seed."""

    assembly: Assembly
    seed: int

    @property
    def assemblies(self) -> tuple[Assembly, ...]:
        return (self.assembly,)


@dataclass(frozen=True)
class Walk(SeededRun):
    """A run in figures."""

    run: int = field(default=0, compare=False)
    model = RunResult

    def do(self) -> RunResult:
        return walk(self.assembly, self.run, self.seed)

    @property
    def companions(self) -> Hashable:
        """Walks of one controller in MuJoCo."""
        a = self.assembly
        return (a.controller, a.policy) if type(a) is Assembly and a.simulation.plant == "mujoco" else None

    @classmethod
    def do_together(cls, jobs: Sequence["Walk"]) -> Iterator[tuple["Walk", RunResult]]:
        assemblies, numbers, seeds = zip(*((job.assembly, job.run, job.seed) for job in jobs), strict=True)
        with parts(assemblies[0]) as (_, controller):
            for place, result in walk_together(controller, assemblies, numbers, seeds):
                yield jobs[place], result


@dataclass(frozen=True)
class RecordedWalk(SeededRun):
    """A run with all its ticks."""

    suffix = ".npz"

    def do(self) -> WalkRecords:
        return record_walk(self.assembly, self.seed)

    def write(self, result: WalkRecords, path: Path) -> None:
        save_records(result, path)

    def read(self, path: Path) -> WalkRecords:
        return load_records(path)


@dataclass(frozen=True)
class Scenario:
    """`runs` runs of an assembly, those of `rabbit evaluate --seed SEED`."""

    assembly: Assembly
    runs: int
    seed: int
    title: str = ""

    @property
    def walks(self) -> list[Walk]:
        """A job for each run."""
        seeds = episode_seeds(self.seed, self.runs)
        return [Walk(self.assembly, seed, run, title=self.title) for run, seed in seeds.items()]

    @property
    def recorded(self) -> RecordedWalk:
        """The first run, with all its ticks."""
        return RecordedWalk(self.assembly, episode_seeds(self.seed, 1)[0], title=self.title)
