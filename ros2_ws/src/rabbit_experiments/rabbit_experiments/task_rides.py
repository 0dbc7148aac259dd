"""Seeded rides of a control task as jobs: over processes, kept, and gone on with; and the plants of its benchmark."""

from collections import Counter
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from math import inf
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict
from rabbit_description.state import Array
from rabbit_description.task import ControlTask
from rabbit_description.task_simulation import TaskSimulations
from rabbit_description.task_source import files_of, load_task
from rabbit_description.task_state import p_of, x_of
from rl_cbf_clf_controller.batch_output import BatchOutput
from rl_cbf_clf_controller.task_controller import TaskController
from rl_trainer.rollout import Shares, rollout_together
from rl_trainer.task_episode import ride_of

from rabbit_experiments.cache import Job
from rabbit_experiments.summary import mean_interval, wilson

APART = 1_000_000  # seeds of evaluations begin here times the user's; those of trainings are 32 bits long, drawn
SHARES = (0.0, 0.5, 1.0, 1.5, 2.0)  # of the way from a nominal parameter to the true one
Plant = tuple[tuple[str, float], ...]  # true parameters, by name


class RideRow(BaseModel):
    """What a ride leaves behind. `margins`: the least value of each barrier, -inf after a failure."""

    model_config = ConfigDict(frozen=True)

    seed: int
    ticks: int
    outcome: str
    reason: str
    kept: bool
    impacts: int
    margins: list[float]


@dataclass(frozen=True)
class TaskRide(Job):
    """A ride under a controller, given by its name or as a policy's file.

    `plant`: the true parameters in place of the task's `true`; `files`: those that the task is made of.
    """

    task: str
    files: tuple[Path, ...]
    controller: str
    seed: int
    plant: Plant = ()
    model = RideRow

    def do(self) -> RideRow:
        controller = controller_of(self.task, self.plant, self.stamps)
        ride = ride_of(controller, controller.controlling(self.controller), self.seed)
        ended = ride.outcome, ride.reason
        return row_of(ride.task, self.seed, len(ride.moments), ride.impacts, ended, ride.margins)

    @property
    def stamps(self) -> tuple[int, ...]:
        """When each of the files was changed, ns."""
        return tuple(file.stat().st_mtime_ns for file in self.files)

    @property
    def companions(self) -> Hashable:
        """Rides that differ in their seeds alone; a controller without a QP rides alone."""
        has_qp = ":" not in self.controller and self.controller not in task_of(self.task, self.stamps).controllers
        return (self.task, self.controller, self.plant) if has_qp else None

    @classmethod
    def do_together(cls, jobs: Sequence["TaskRide"]) -> Iterator[tuple["TaskRide", RideRow]]:
        """The rows that they have alone, to the bit."""
        first = jobs[0]
        controller = controller_of(first.task, first.plant, first.stamps)
        rows = rides_together(controller, first.controller, [job.seed for job in jobs])
        return ((jobs[place], row) for place, row in rows)


def rides_together(controller: TaskController, name: str, seeds: Sequence[int]) -> Iterator[tuple[int, RideRow]]:
    """Rides side by side: place and row of a ride as it ends."""
    task, n = controller.task, len(seeds)
    batch = controller.batch(controller.controlling(name), n)
    at, least = controller.output_places.arrays["barriers"], np.full((n, len(task.barriers)), np.inf)

    def observe(places: Array, output: BatchOutput) -> None:
        least[places] = np.minimum(least[places], output.report[:, at])

    for ended in rollout_together(TaskSimulations(task, n), batch, seeds, observe, Shares()):
        state, place = ended.state, ended.place
        ticks, verdict = state.tick, ended.simulation.verdict
        if ended.fault:
            ticks, verdict = ticks + 1, ("no answer", ended.fault)
        else:
            after = task.tick.look(x_of(task, state), p_of(state)).barriers
            least[place] = np.minimum(least[place], after)
        yield place, row_of(task, seeds[place], ticks, state.touchdowns, verdict, least[place])


def row_of(task: ControlTask, seed: int, ticks: int, impacts: int, verdict: tuple[str, str], margins: Array) -> RideRow:
    """What a ride leaves behind that has ended; `margins`: the least value of each barrier until then."""
    outcome, reason = verdict
    margins = margins if outcome == "done" else np.full(margins.shape, -inf)
    ended = {"outcome": outcome, "reason": reason, "kept": task.keeps(outcome, margins), "impacts": impacts}
    return RideRow(seed=seed, ticks=ticks, margins=margins.tolist(), **ended)


@lru_cache(maxsize=1)
def task_of(source: str, stamps: tuple[int, ...]) -> ControlTask:
    """The task whose files have these time stamps."""
    return load_task(source)


@lru_cache(maxsize=1)
def controller_of(source: str, plant: Plant, stamps: tuple[int, ...]) -> TaskController:
    """The controller of a task on this plant."""
    task = task_of(source, stamps)
    return TaskController(replace(task, true={**task.true, **dict(plant)}) if plant else task)


def rides_of(source: str, controllers: Sequence[str], rides: int, seed: int, plant: Plant = ()) -> list[TaskRide]:
    """So many rides of each controller, the same for all."""
    files, seeds = files_of(source), range(APART * seed, APART * seed + rides)
    return [TaskRide(source, files, name, seed, plant, title=name) for name in controllers for seed in seeds]


def plants_of(task: ControlTask) -> dict[str, Plant]:
    """The plants by name: every true parameter at the `SHARES`, the others nominal; then all together."""
    off = list(task.true)
    plants = {}
    for varied in [[name] for name in off] + [off] * (len(off) > 1):
        for share in SHARES:
            way = {name: task.nominal[name] + share * (task.true[name] - task.nominal[name]) for name in varied}
            said = "all" if len(varied) > 1 else varied[0]
            values = f"{share:g} of the way" if len(varied) > 1 else f"{way[varied[0]]:.4g}"
            plants[f"{said}: {values}"] = tuple(({name: task.nominal[name] for name in off} | way).items())
    return plants


def summarise(task: ControlTask, rides: Sequence[RideRow]) -> dict[str, Any]:
    """The figures of one controller's rides; those of a barrier are of rides that did not fail."""
    kept = sum(ride.kept for ride in rides)
    summary: dict[str, Any] = {"kept": kept, "of": len(rides), "kept_ci95": wilson(kept, len(rides)), "barriers": {}}
    done = np.array([ride.margins for ride in rides if ride.outcome == "done"])
    for name, margins in zip((b.name for b in task.barriers), done.T, strict=False):
        figures = {"worst": float(margins.min()), "mean": float(margins.mean()), "mean_ci95": mean_interval(margins)}
        summary["barriers"][name] = figures
    if task.impact:
        counts = np.array([float(ride.impacts) for ride in rides])
        ends = mean_interval(counts, 0.0, inf if task.impacts is None else task.impacts)
        summary["impacts"] = {"mean": float(counts.mean()), "mean_ci95": ends}
    reasons = Counter(ride.reason.partition(" =")[0] for ride in rides if ride.reason)
    return summary | {"outcomes": dict(Counter(ride.outcome for ride in rides)), "reasons": dict(reasons)}
