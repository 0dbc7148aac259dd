"""The controllers of a control task by name: nominal, oracle, a learned policy, or one of the task's own."""

from functools import cached_property
from pathlib import Path

import numpy as np
from cbf_clf_qp.answer import Decided
from cbf_clf_qp.estimates import Estimates, measure, model_error
from cbf_clf_qp.functions import Array, NumpyFunction, Values, places_of
from rabbit_description import plugins
from rabbit_description.state import Leg, RobotState
from rabbit_description.task import ControlTask, TaskError
from rabbit_description.task_simulation import TaskSimulation
from rabbit_description.task_state import p_of, x_of
from rabbit_description.validation import one_of

from rl_cbf_clf_controller.controller_output import NOTHING, ControllerOutput
from rl_cbf_clf_controller.policy import ActorPolicy, LearnedPolicy
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.weights import PolicyFile, PolicyFileError, read

NOMINAL, ORACLE = "nominal", "oracle"
KINDS = "rabbit.task_controllers"  # entry points: functions of (task, path) that give an `OwnController`
Controlling = LearnedPolicy | str  # a policy, or a controller's name


class TaskController:
    """One controller of a task, as `Controller` is of RABBIT; `step` is called once a tick.

    `problem`: what is learned on the task. `policy`: who decides, see `controlling`; `sigma`: the deviation of what
    exploration adds to mu; both may be set between two ticks. `true`: the plant's parameters, which the oracle knows;
    they may change too. After a tick `estimates` and `decided` have all of it, None under a controller without a QP.
    """

    def __init__(self, task: ControlTask, problem: Problem | None = None) -> None:
        self.task, self.own, self.true, self.sigma = task, dict(task.controllers), dict(task.true), 0.0
        terms, observed = task.tick.terms, tuple(task.observed)
        units = tuple((name, 0.0, 1.0) for name in observed)
        self.problem = problem or Problem(task.name, terms.inputs, terms.names, observed, units)
        self.estimates: Estimates | None = None
        self.decided: Decided | None = None
        self._limit = np.inf if task.limit is None else task.limit
        self._error, self._places = model_error(terms), places_of(task.system.named)
        self.policy = NOMINAL
        self.reset(0)

    @property
    def policy(self) -> Controlling:
        """Who decides."""
        return self._policy

    @policy.setter
    def policy(self, policy: Controlling) -> None:
        self._policy = policy
        self.version = policy if isinstance(policy, str) else policy.version
        self.task.tick.reset()

    def reset(self, seed: int) -> None:
        """Begin an episode; the exploration noise starts from `seed`."""
        self.task.tick.reset()
        self._exploring, self._drawn = self.task.beginning(seed)[2], 0
        self._last: tuple[RobotState, Array] | None = None  # the state before, and the input there

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

    def rehearse(self) -> None:
        """Compute a tick that nobody rides: the first call of a function takes longer."""
        self.step(TaskSimulation(self.task).reset(0))
        self.reset(0)

    def output(self) -> ControllerOutput:
        """All of the last tick."""
        return self._output

    def step(self, state: RobotState) -> ControllerOutput:
        """One tick: the input, and all that others read of it; raises whatever a controller of the task raises."""
        task, tick, x, p = self.task, self.task.tick, x_of(self.task, state), p_of(state)
        seen = tick.look(x, p)
        told = {
            **{"tick": state.tick, "step_index": state.touchdowns, "step_time": state.tick * task.seconds},
            **{"stance": Leg.LEFT, "phase": np.nan, "barriers": seen.barriers, "observation": seen.observation},
            **{"barrier_rates": seen.barriers * np.nan, "barrier_names": tuple(each.name for each in task.barriers)},
            **({"V": seen.V.item(), "eta": seen.eta} if "V" in tick.names else {"V": np.nan, "eta": NOTHING}),
            "policy_version": self.version,
        }
        own = self.own.get(self.policy) if isinstance(self.policy, str) else None
        if own:
            u = np.asarray(own(x, p), dtype=float).reshape(task.system.u.numel()).clip(-self._limit, self._limit)
            told |= dict.fromkeys(("mu", "mu_qp", "omega", "alpha", "beta", "LgV"), NOTHING)
            told |= {"quantities": (), "clf_slack": np.nan, "rescue_slack": np.nan, "active": (), "objective": ""}
            told |= {"solver": "", "status": "", "answered": True, "solve_seconds": 0.0}
            self.estimates = self.decided = None
        else:
            u, of_programme = self._by_programme(state, x, p, seen)
            told |= of_programme
        fault = "" if np.isfinite(u).all() else f"u = {u}: expected finite numbers"
        if self.decided and not self.decided.solved:
            fault = f"no solver answered: {self.decided.status}"
        self._last = state, u
        is_saturated = bool(np.abs(u).max() >= self._limit)
        told |= {"torque": np.zeros_like(u) if fault else u, "saturated": is_saturated, "fault": fault}
        self._output = ControllerOutput(**told)
        return self._output

    def _by_programme(self, state: RobotState, x: Array, p: Array, seen: Values) -> tuple[Array, dict[str, object]]:
        """The input (m,) that the QP decides, and what is told of it; `measured` is NaN after an impact or a gap."""
        task, tick = self.task, self.task.tick
        LgV = seen.nominal_a[0] if self.problem.has_clf else np.zeros(self.problem.inputs)
        self.estimates = estimates = self._estimates(x, p, seen, LgV)
        self.decided = decided = tick.decide(x, p, estimates)
        values, omega = decided.values, self.sigma * self._noise(state.tick)
        mu = decided.mu + omega
        u: Array = values.control_a @ mu + values.control_b
        if np.abs(u).max() > self._limit:
            u = u.clip(-self._limit, self._limit)
            mu = np.linalg.solve(values.control_a, u - values.control_b)
        mu_held, measured = np.full(self.problem.inputs, np.nan), np.full(len(tick.names), np.nan)
        if self._last and (state.tick, state.touchdowns) == (self._last[0].tick + 1, self._last[0].touchdowns):
            before, held = self._last
            mu_held = np.linalg.solve(seen.control_a, held - seen.control_b)
            if self._measure:
                measured = self._measure(x_of(task, before), p_of(before), x, p, np.array([task.seconds])).measured
        clf_slack, rescue_slack = values.slack_sums.tolist()
        return u, {
            **{"mu": mu, "mu_qp": decided.mu, "omega": omega, "mu_held": mu_held, "measured": measured, "LgV": LgV},
            **{"quantities": tick.names, "nominal_a": seen.nominal_a, "nominal_b": seen.nominal_b},
            **{"alpha": estimates.alpha, "beta": estimates.beta, "objective": "own" if task.objective else "paper"},
            **{"rows": decided.layout.names, "active": decided.active, "margins": values.row_margin},
            **{"slacks": values.slack, "multipliers": values.multiplier},
            **{"clf_slack": clf_slack, "rescue_slack": rescue_slack, "solver": decided.solver},
            **{"status": decided.status, "answered": decided.is_by(tick.answer.solver)},
            "solve_seconds": decided.seconds,
        }

    def _noise(self, tick: int) -> Array:
        """Of this tick of the episode, (m,): the same whether or not the ticks before it were seen."""
        for _ in range(self._drawn, min(tick, self.task.ticks)):
            self._exploring.standard_normal(self.problem.inputs)
        self._drawn = max(self._drawn, min(tick, self.task.ticks)) + 1
        return self._exploring.standard_normal(self.problem.inputs)

    @cached_property
    def _measure(self) -> NumpyFunction | None:
        """None where one difference does not measure the quantities; then nothing is learned."""
        try:
            return measure(self.task.tick.terms)
        except ValueError:
            return None

    def _estimates(self, x: Array, p: Array, seen: Values, LgV: Array) -> Estimates:
        if isinstance(self.policy, LearnedPolicy):
            return self.policy.act(seen.observation, LgV)
        if self.policy != ORACLE:
            return self.task.tick.no_error()
        true = p.astype(float)
        for name, value in self.true.items():
            true[self._places[name][0]] = np.ravel(value)
        error = self._error(x, p, true)
        return Estimates(error.alpha, error.beta, error.output_error)
