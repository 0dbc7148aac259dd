"""Who answers the states that the controller's node takes in: RABBIT's controller, or a control task's."""

from functools import partial
from typing import Any, Protocol

import numpy as np
from cbf_clf_qp.functions import Array
from rabbit_common.ros.diagnostics import BARRIER
from rabbit_description.gait import Gaits
from rabbit_description.state import RobotState
from rabbit_description.task import ControlTask, TaskError
from rabbit_description.task_state import x_of
from rabbit_description.user_code import fault_in_user_code
from rabbit_msgs.msg import Episode

from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.fitted_policy import fitted
from rl_cbf_clf_controller.message_fields import state_fields, terms_fields
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.ros.policies import ZERO, CheckedPolicy, Fit
from rl_cbf_clf_controller.task_controller import NOMINAL, ORACLE, Controlling, Moment, TaskController
from rl_cbf_clf_controller.task_message_fields import controller_fields as task_state_fields
from rl_cbf_clf_controller.task_message_fields import terms_fields as task_terms_fields


class Answerer(Protocol):
    """`built_in`: its controllers or policies by name; `fit`: what it makes of a policy's file."""

    built_in: dict[str, CheckedPolicy]
    fit: Fit

    def begin(self, episode: Episode) -> None:
        """Another episode."""

    def follow(self, policy: Any) -> None:
        """Another policy, from the next tick on; the first one before the first tick."""

    def act(self, state: RobotState) -> tuple[Array, str]:
        """The input (m,), and why the episode must end, or nothing; raises any error of a user's code."""

    def state_fields(self) -> dict[str, Any]:
        """Of `ControllerState`."""

    def terms_fields(self) -> dict[str, Any] | None:
        """Of `LearnerTerms`; None: there is nothing to learn from."""

    def figures(self) -> dict[str, object]:
        """For diagnostics."""


class RabbitAnswerer:
    """With the controller of RABBIT."""

    def __init__(self, parameters: ControllerParameters, gaits: Gaits) -> None:
        zero = ZeroPolicy(parameters.problem)
        self.built_in = {ZERO: CheckedPolicy(ZERO, "built in", zero)}
        self.fit: Fit = partial(fitted, parameters=parameters, gaits=gaits)
        self.controller = Controller(parameters, gaits, zero)
        self.is_new = True

    def begin(self, episode: Episode) -> None:
        """See `Answerer`."""
        self.controller.reset(episode.seed)

    def follow(self, policy: Any) -> None:
        """See `Answerer`."""
        self.controller.policy = policy
        if self.is_new:
            self.is_new = False
            self.controller.rehearse()

    def act(self, state: RobotState) -> tuple[Array, str]:
        """See `Answerer`."""
        acted = self.controller.act(state)
        return acted.torque, acted.fault

    def state_fields(self) -> dict[str, Any]:
        """See `Answerer`."""
        return state_fields(self.controller.output())

    def terms_fields(self) -> dict[str, Any]:
        """See `Answerer`."""
        return terms_fields(self.controller.output())

    def figures(self) -> dict[str, object]:
        """See `Answerer`."""
        output = self.controller.output()
        barriers = zip(output.barrier_names, output.barriers.tolist(), strict=True)
        return {
            "ticks not answered by the chosen solver": self.controller.unanswered,
            "CLF slack": output.clf_slack,
            **{BARRIER + name: B for name, B in barriers},
        }


class TaskAnswerer:
    """With a task's controllers, by name, and its policies."""

    def __init__(self, task: ControlTask, policy: str) -> None:
        """`policy`: the one to begin with; raises `TaskError`."""
        if policy == ORACLE and not task.true:
            raise TaskError(f"policy oracle: expected true parameters in the task {task.name}; it has none")
        self.task, self.controller = task, TaskController(task)
        if ":" in policy:
            self.controller.controlling(policy)
        names = [name for name in self.controller.names if name != ORACLE or task.true]
        self.built_in = {name: CheckedPolicy(name, "built in", name) for name in names}
        self.built_in[ZERO] = self.built_in[NOMINAL]
        self.fit: Fit = self.controller.fitted
        self._controlling: Controlling = NOMINAL
        self._sigma, self._exploring = 0.0, np.random.default_rng(0)
        self._moment: Moment | None = None

    def begin(self, episode: Episode) -> None:
        """See `Answerer`."""
        self._sigma = 0.0 if np.isnan(episode.sigma) else episode.sigma
        self._exploring = self.task.beginning(episode.seed)[2]
        self.controller.begin(self._controlling)

    def follow(self, policy: Any) -> None:
        """See `Answerer`."""
        self._controlling = policy
        self.controller.begin(policy)
        if self._moment is None:  # a rehearsal: the first call of a function takes longer
            x, commands, _ = self.task.beginning(0)
            self.decide(0, x, self.task.parameters_at({}, commands(0.0)), np.zeros(self.controller.problem.inputs))
            self.controller.begin(policy)

    def act(self, state: RobotState) -> tuple[Array, str]:
        """See `Answerer`."""
        assert state.parameters is not None
        noise = self._sigma * self._exploring.standard_normal(self.controller.problem.inputs)
        return self.decide(state.tick, x_of(self.task, state), state.parameters, noise).u, ""

    def decide(self, tick: int, x: Array, p: Array, noise: Array) -> Moment:
        """The tick at a state; raises ValueError: no answer, which is a line."""
        self.controller.ticks.interrupt()  # nothing is learned here
        try:
            moment = self.controller.moment(self._controlling, tick * self.task.seconds, x, p, noise)
        except Exception as error:  # a controller of the task's own may raise anything
            raise ValueError(fault_in_user_code(error) or str(error)) from error
        if moment.decided is not None and not moment.decided.solved:
            raise ValueError(f"no solver answered: {moment.decided.status}")
        if not np.isfinite(moment.u).all():
            raise ValueError(f"u = {moment.u}: expected finite numbers")
        self._moment = moment
        return moment

    @property
    def moment(self) -> Moment:
        """Of the last tick."""
        assert self._moment
        return self._moment

    def state_fields(self) -> dict[str, Any]:
        """See `Answerer`."""
        name = self._controlling if isinstance(self._controlling, str) else self._controlling.version
        return task_state_fields(self.task, self.moment, name)

    def terms_fields(self) -> dict[str, Any] | None:
        """See `Answerer`."""
        return None if self.moment.decided is None else task_terms_fields(self.task, self.moment)

    def figures(self) -> dict[str, object]:
        """See `Answerer`."""
        return {}
