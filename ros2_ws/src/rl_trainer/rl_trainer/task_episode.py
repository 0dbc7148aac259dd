"""One episode of a task under one of its controllers: nominal, oracle, a learned policy, or one of its own.

ride = Rider(task).ride("nominal", seed=1)        all ticks, and how it ended
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np
from cbf_clf_qp.functions import Array
from rabbit_description.task import Commands, ControlTask
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.task_controller import Controlling, Moment, TaskController

from rl_trainer.systems import SystemTicks


@dataclass
class Ride:
    """An episode: its moments; `outcome` is done, failed, or no answer; `impacts`: how many there were.

    `last`: state x (n,) and the model's parameters p (k,) after the last tick, which no controller sees; None: not
    known.
    `reason`: of a failure, which limit was passed, by name and value.
    """

    task: ControlTask
    controller: str
    seed: int
    moments: list[Moment] = field(default_factory=list)
    outcome: str = "done"
    impacts: int = 0
    last: tuple[Array, Array] | None = None
    reason: str = ""

    @property
    def title(self) -> str:
        """Of its pictures."""
        return f"{self.task.name}, {self.controller}, seed {self.seed}: {self.outcome}"

    @property
    def has_qp(self) -> bool:
        """Whether its controller solves a QP."""
        return any(moment.decided is not None for moment in self.moments)

    @property
    def barriers(self) -> Array:
        """Of each state, that after the last tick too, a row of the values of B, each in its unit."""
        last = [] if self.last is None else [self.task.tick.look(*self.last).barriers]
        return np.array([*(each.barriers for each in self.moments), *last])

    @property
    def margins(self) -> Array:
        """Of each barrier over the ride; -inf after a failure."""
        if self.outcome != "done":
            return np.full(len(self.task.barriers), -np.inf)
        least: Array = self.barriers.min(axis=0)
        return least

    @property
    def is_kept(self) -> bool:
        """Whether it ended well, and no barrier was below its tolerance."""
        return self.outcome == "done" and bool((self.margins >= -self.task.tolerance).all())


class Rider(TaskController):
    """Rides a task, and gathers transitions, see `SystemTicks`."""

    ticks: SystemTicks

    def __init__(self, task: ControlTask, problem: Problem | None = None) -> None:
        super().__init__(task, problem)
        self.altered: Callable[[Commands], Commands] = lambda commands: commands  # what an episode's become

    def _make_ticks(self) -> SystemTicks:
        return SystemTicks(self.task.tick, self.problem, self.task.seconds, self.limit)

    def ride(self, controlling: Controlling, seed: int, noise: float = 0.0) -> Ride:
        """An episode; `noise` is the deviation of what exploration adds to mu."""
        name = controlling if isinstance(controlling, str) else controlling.version
        ride = Ride(self.task, name, seed)
        for moment in self.moments(controlling, seed, noise, ride):
            ride.moments.append(moment)
            if moment.decided is not None and not moment.decided.solved:
                ride.outcome = "no answer"
                break
        return ride

    def moments(
        self, controlling: Controlling, seed: int, noise: float = 0.0, ride: Ride | None = None
    ) -> Iterator[Moment]:
        """The ticks of an episode, one after another, until it ends; `ride` is told how."""
        task, k, impacts, outcome = self.task, 0, 0, ""
        x, commands, exploring = task.beginning(seed)
        commands = self.altered(commands)
        self.begin(controlling)
        while not outcome:
            time = k * task.seconds
            commanded = commands(time)
            added = noise * exploring.standard_normal(self.problem.inputs)
            moment = self.moment(controlling, time, x, task.parameters_at({}, commanded), added)
            yield replace(moment, impacts=impacts) if impacts else moment
            true = task.parameters_at(self.true, commanded)
            moved = task.moved(x, true, moment.u)
            x, k, impacts = moved.x, k + 1, impacts + moved.impacts
            if moved.impacts:  # the next tick does not follow from this one by the model
                self.ticks.interrupt()
            outcome = task.outcome(moved, true, k, impacts)
            if ride:
                ride.outcome, ride.impacts = outcome, impacts
                ride.last = x, task.parameters_at({}, commands(k * task.seconds))
                ride.reason = task.why_failed(moved, true, impacts) if outcome == "failed" else ""
