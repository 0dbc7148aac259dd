"""The controllers of a control task by name: nominal, oracle, a learned policy, or one that the task brings."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from cbf_clf_qp.answer import Decided
from cbf_clf_qp.batch_functions import BatchFunction
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.functions import Array, Values, one_at_a_time, places_of
from rabbit_description import plugins
from rabbit_description.state import Leg, RobotState
from rabbit_description.task import ControlTask, TaskError
from rabbit_description.task_simulation import TaskSimulation
from rabbit_description.task_state import p_of, x_of
from rabbit_description.validation import one_of

from rl_cbf_clf_controller.batch_controller import BatchController
from rl_cbf_clf_controller.controller import OneRobot
from rl_cbf_clf_controller.controller_output import NOTHING, Acted, ControllerOutput
from rl_cbf_clf_controller.policy import ActorPolicy, LearnedPolicy, Policy, ZeroPolicy
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.scene import Scene
from rl_cbf_clf_controller.step import DQ, Q
from rl_cbf_clf_controller.task_step import TaskParameters, TaskStep
from rl_cbf_clf_controller.weights import PolicyFile, PolicyFileError, read

NOMINAL, ORACLE = "nominal", "oracle"
KINDS = "rabbit.task_controllers"  # entry points: functions of (task, path) that give an `OwnController`
Controlling = LearnedPolicy | str  # a policy, or a controller's name


class TaskOracle(Policy):
    """The exact errors of a plant with the `true` parameters, by name."""

    version = ORACLE

    def __init__(self, controller: "TaskController") -> None:
        self._true, self._error = controller.true, BatchFunction(controller.model_error)
        self._places = places_of(controller.task.system.named)

    def values_of_many(self, x: Array, p: Array) -> Values:
        """The estimates, in rows, at N states x (N, n) and the model's parameters p (N, k) there."""
        true = p.copy()
        for name, value in self._true.items():
            true[:, self._places[name][0]] = value
        return self._error(x, p, true)

    def estimate(self, scene: Scene, before: Estimates) -> Estimates:
        errors = self.values_of_many(scene.x[None], scene.p[None])[0]
        return Estimates(errors.alpha, errors.beta, errors.output_error)


class Noise:
    """What exploration draws in an episode: a tick's is the same whether or not the ticks before it were seen."""

    def __init__(self, task: ControlTask, seed: int, m: int) -> None:
        self._rng, self._ticks, self._m, self._drawn = task.beginning(seed)[2], task.ticks, m, 0

    def at(self, tick: int) -> Array:
        """The noise of a tick, (m,)."""
        for _ in range(self._drawn, min(tick, self._ticks)):
            self._rng.standard_normal(self._m)
        self._drawn = max(self._drawn, min(tick, self._ticks)) + 1
        return self._rng.standard_normal(self._m)


class TaskBatch(BatchController):
    """N systems under copies of one task's controller, all with one policy."""

    _one: "TaskController"

    def reset(self, i: int, seed: int) -> None:
        super().reset(i, seed)
        self._rngs[i] = Noise(self._one.task, seed, self._silence.shape[1])

    def only_policy(self) -> Any:
        return self.policies[0]

    def _learned(self, policy: Any, seen: Array) -> Array:
        if isinstance(policy, TaskOracle):
            x, p = seen[:, self._one.functions.scene.places["x"][0]], self._reading["parameters"]
            return policy.values_of_many(x, p).row
        if isinstance(policy, ZeroPolicy) or (isinstance(policy, ActorPolicy) and policy.is_structured):
            return super()._learned(policy, seen)
        estimates = policy.act_of_many(*(seen[:, place] for place in self._one.learned_from))
        self._one.check_estimates(estimates)
        return self._take(estimates)

    def _read(self, states: Any) -> None:
        states = [states] if isinstance(states, RobotState) else states
        for name in ("q", "dq", "parameters"):
            self._reading[name][...] = [getattr(state, name) for state in states]
        self._tick[...] = [state.tick for state in states]
        self._touchdowns[...] = [state.touchdowns for state in states]

    def _drawn(self) -> Array:
        return np.array([rng.at(int(tick)) for rng, tick in zip(self._rngs, self._tick, strict=True)])

    def _why_refused(self, state: RobotState, kind: int) -> str:
        name = {Q: "q", DQ: "dq"}.get(kind, "parameters")
        return f"state.{name} = {getattr(state, name)}: expected finite numbers"


class TaskController(OneRobot):
    """One controller of a task, as `Controller` is of RABBIT; `step` is called once a tick.

    `problem`: what is learned on the task. `policy`: who decides, see `controlling`; `sigma`: the deviation of what
    exploration adds to mu; both may be set between two ticks. `true`: the plant's parameters, which the oracle knows;
    they may change too. After a tick `estimates` and `decided` have all of it, None under a controller without a QP.
    """

    @one_at_a_time
    def __init__(self, task: ControlTask, problem: Problem | None = None) -> None:
        self.task, self.brought, self.true = task, dict(task.controllers), dict(task.true)
        terms, observed = task.tick.terms, tuple(task.observed)
        units = tuple((name, 0.0, 1.0) for name in observed)
        self.problem = problem or Problem(task.name, terms.inputs, terms.names, observed, units)
        limit = np.inf if task.limit is None else task.limit
        parameters = TaskParameters("own" if task.objective else "paper", limit)
        names = [barrier.name for barrier in task.barriers]
        super().__init__(task.tick, TaskStep(task), names, len(observed), parameters)
        self._nominal = ZeroPolicy(self.problem)
        self._nominal.version, self._oracle = NOMINAL, TaskOracle(self)
        self.name, self.robots, self.policy = task.name, self.batch(NOMINAL, 1), NOMINAL

    def batch(self, controlling: Controlling, n: int) -> TaskBatch:
        """N systems under copies of this one."""
        return TaskBatch(self, [self.estimating(controlling)] * n)

    @property
    def policy(self) -> Controlling:
        """Who decides."""
        return self._policy

    @policy.setter
    def policy(self, policy: Controlling) -> None:
        self._policy = policy
        self.version = policy if isinstance(policy, str) else policy.version
        self.robots.policies[0] = self.estimating(policy)

    def estimating(self, controlling: Controlling) -> Policy:
        """The policy whose estimates the QP takes."""
        if isinstance(controlling, LearnedPolicy):
            return controlling
        return self._oracle if controlling == ORACLE else self._nominal

    @property
    def sigma(self) -> float:
        """The deviation of exploration."""
        return self._parameters.sigma

    @sigma.setter
    def sigma(self, sigma: float) -> None:
        self._parameters = replace(self._parameters, sigma=sigma)
        self.robots.set_parameters(self._parameters)

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the controllers that are no policies."""
        return NOMINAL, ORACLE, *self.brought

    def controlling(self, name: str) -> Controlling:
        """A controller by its name, a policy by its file, or KIND:FILE of a package; raises `TaskError`."""
        if name in self.names:
            return name
        kind, _, path = name.partition(":")
        if path:
            try:
                self.brought[name] = plugins.load(KINDS, kind)(self.task, Path(path))
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
        self.compile()
        self.step(TaskSimulation(self.task).reset(0))
        self.reset(0)

    def act(self, state: RobotState) -> Acted | ControllerOutput:
        """What acts in one tick; raises whatever a controller of the task raises."""
        controller = self.brought.get(self.policy) if isinstance(self.policy, str) else None
        self._without_qp = self._decided_by(controller, state) if controller else None
        return self._without_qp or super().act(state)

    def output(self) -> ControllerOutput:
        """All of the last tick."""
        return self._without_qp or super().output()

    @property
    def decided(self) -> Decided | None:  # type: ignore[override]
        """What the last tick decided."""
        return None if self._without_qp else super().decided

    @property
    def estimates(self) -> Estimates | None:  # type: ignore[override]
        """The estimates of the last tick."""
        return None if self._without_qp else super().estimates

    def _decided_by(self, controller: Any, state: RobotState) -> ControllerOutput:
        """What a controller that the task brings decides; it has no QP."""
        task, x, p = self.task, x_of(self.task, state), p_of(state)
        seen, limit = task.tick.look(x, p), self.parameters.torque_limit
        u = np.asarray(controller(x, p), dtype=float).reshape(task.system.u.numel()).clip(-limit, limit)
        fault = "" if np.isfinite(u).all() else f"u = {u}: expected finite numbers"
        told: Mapping[str, Any] = {
            **{"tick": state.tick, "step_index": state.touchdowns, "step_time": state.tick * task.seconds},
            **{"stance": Leg.LEFT, "phase": np.nan, "barriers": seen.barriers, "observation": seen.observation},
            **{"barrier_rates": seen.barriers * np.nan, "barrier_names": self.barrier_names},
            **({"V": seen.V.item(), "eta": seen.eta} if "V" in task.tick.names else {"V": np.nan, "eta": NOTHING}),
            **dict.fromkeys(("mu", "mu_qp", "omega", "alpha", "beta", "LgV"), NOTHING),
            **{"quantities": (), "clf_slack": np.nan, "rescue_slack": np.nan, "active": (), "objective": ""},
            **{"solver": "", "status": "", "answered": True, "solve_seconds": 0.0, "policy_version": self.version},
            **{"torque": np.zeros_like(u) if fault else u, "saturated": bool(np.abs(u).max() >= limit)},
        }
        return ControllerOutput(**told, fault=fault)
