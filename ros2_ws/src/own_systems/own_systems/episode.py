"""One episode of a task under one of its controllers: nominal, oracle, a learned policy, or one of its own.

ride = Rider(task).ride("nominal", seed=1)        all ticks, and how it ended
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from cbf_clf_qp.answer import Decided
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.functions import Array
from rabbit_description import plugins
from rabbit_description.validation import one_of
from rl_cbf_clf_controller.policy import ActorPolicy, LearnedPolicy
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.weights import PolicyFile, PolicyFileError, read
from rl_trainer.systems import SystemTick, SystemTicks

from own_systems.task import Commands, ControlTask, TaskError

NOMINAL, ORACLE = "nominal", "oracle"
KINDS = "rabbit.task_controllers"  # entry points: functions of (task, path) that give an `OwnController`
Controlling = LearnedPolicy | str  # a policy, or a controller's name


@dataclass(frozen=True)
class Moment:
    """A tick: state x (n,), parameters p (k,) that the model has, the input u (m,), and what led to it.

    `barriers` (b,): the values of B; `impacts`: how many came before. `seen`, `estimates`, `decided` are None under a
    controller without a QP.
    """

    time: float
    x: Array
    p: Array
    u: Array
    barriers: Array
    seen: Any = None
    estimates: Estimates | None = None
    decided: Decided | None = None
    mu: Array | None = None
    impacts: int = 0


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


def beginning(task: ControlTask, seed: int) -> tuple[Array, Commands, np.random.Generator]:
    """Of an episode: its first state x (n,), its commands, and the generator of what exploration adds to mu."""
    course, exploring = (np.random.default_rng(each) for each in np.random.SeedSequence(seed).spawn(2))
    return course.uniform(*np.asarray(task.start, dtype=float)), task.commands(course), exploring


class Rider:
    """Rides a task. `problem` is what is learned on it; without one it can be ridden, and not learned on."""

    def __init__(self, task: ControlTask, problem: Problem | None = None) -> None:
        self.task, self.own = task, dict(task.controllers)
        self.true = dict(task.true)  # of the plant; may change between two ticks
        self.altered: Callable[[Commands], Commands] = lambda commands: commands  # what an episode's become
        terms = task.tick.terms
        observed = tuple(task.observed)
        units = tuple((name, 0.0, 1.0) for name in observed)
        self.problem = problem or Problem(task.name, terms.inputs, terms.names, observed, units)
        self._limit = np.inf if task.limit is None else task.limit
        self.ticks = SystemTicks(task.tick, self.problem, task.seconds, self._limit)

    @property
    def names(self) -> tuple[str, ...]:
        """Of the controllers that are no policies."""
        return NOMINAL, ORACLE, *self.own

    def controlling(self, name: str) -> Controlling:
        """A controller by its name, a policy by its file, or KIND:FILE of a package; raises `TaskError`."""
        if name in self.names:
            return name
        kind, _, path = name.partition(":")
        if path:
            try:
                self.own[name] = plugins.load(KINDS, kind)(self.task, Path(path))
            except plugins.PluginError as error:
                raise TaskError(str(error)) from error
            return name
        if not name.endswith(".safetensors"):
            raise TaskError(f"controller {name}: expected {one_of(name, self.names)}, a policy's file, or KIND:FILE")
        try:
            file = read(Path(name))
        except PolicyFileError as error:
            raise TaskError(str(error)) from error
        try:
            return self.fitted(file)
        except PolicyFileError as error:
            raise TaskError(f"policy {name}: {error}") from error

    def fitted(self, file: PolicyFile) -> ActorPolicy:
        """The policy of a file; raises `PolicyFileError` where it was trained for another task."""
        about, problem = file.metadata, self.problem
        if about.problem != problem.name:
            raise PolicyFileError(f"trained for {about.problem}; this task is {problem.name}")
        now = problem.quantities, problem.inputs, problem.observation
        if (then := (about.names, about.m, about.observation)) != now:
            raise PolicyFileError(f"for {then}: {problem.name} is now {now}")
        return ActorPolicy(file)

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
        x, commands, exploring = beginning(task, seed)
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

    def begin(self, controlling: Controlling) -> None:
        """The first tick of an episode comes next."""
        self.task.tick.reset()
        policy = controlling if isinstance(controlling, LearnedPolicy) else None
        self.ticks.begin(policy, self.true if controlling == ORACLE else None)

    def moment(self, controlling: Controlling, time: float, x: Array, p: Array, noise: Array) -> Moment:
        """The tick at a state."""
        own = self.own.get(controlling) if isinstance(controlling, str) else None
        if own:
            u = np.asarray(own(x, p), dtype=float).reshape(self.task.system.u.numel())
            return Moment(time, x, p, u.clip(-self._limit, self._limit), self.task.tick.look(x, p).barriers)
        now: SystemTick = self.ticks(x, p, noise)
        return Moment(time, x, p, now.control, now.seen.barriers, now.seen, now.estimates, now.decided, now.mu)
