"""The controllers of a control task by name: nominal, oracle, a learned policy, or one of the task's own."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from cbf_clf_qp.answer import Decided
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.functions import Array
from rabbit_description import plugins
from rabbit_description.task import ControlTask, TaskError
from rabbit_description.validation import one_of

from rl_cbf_clf_controller.policy import ActorPolicy, LearnedPolicy
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.task_ticks import TaskTicks
from rl_cbf_clf_controller.weights import PolicyFile, PolicyFileError, read

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


class TaskController:
    """Decides the ticks of a task. `problem`: what is learned on it; without one nothing can be.

    `true`: the plant's parameters, which the oracle knows; they may change between two ticks.
    """

    def __init__(self, task: ControlTask, problem: Problem | None = None) -> None:
        self.task, self.own = task, dict(task.controllers)
        self.true = dict(task.true)
        terms = task.tick.terms
        observed = tuple(task.observed)
        units = tuple((name, 0.0, 1.0) for name in observed)
        self.problem = problem or Problem(task.name, terms.inputs, terms.names, observed, units)
        self.limit = np.inf if task.limit is None else task.limit
        self.ticks = self._make_ticks()

    def _make_ticks(self) -> TaskTicks:
        return TaskTicks(self.task.tick, self.problem, self.limit)

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
            return Moment(time, x, p, u.clip(-self.limit, self.limit), self.task.tick.look(x, p).barriers)
        now = self.ticks(x, p, noise)
        return Moment(time, x, p, now.control, now.seen.barriers, now.seen, now.estimates, now.decided, now.mu)
