"""Who answers the states that the controller's node takes in: RABBIT's controller, or a control task's."""

import math
from abc import ABC, abstractmethod
from functools import partial
from typing import Any

from cbf_clf_qp.functions import Array
from rabbit_common.ros.diagnostics import BARRIER
from rabbit_description.gait import Gaits
from rabbit_description.state import RobotState
from rabbit_description.task import ControlTask, TaskError
from rabbit_description.task_simulation import TaskSimulation
from rabbit_description.user_code import fault_in_user_code
from rabbit_msgs.msg import Episode

from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.controller_output import ControllerOutput
from rl_cbf_clf_controller.fitted_policy import fitted
from rl_cbf_clf_controller.message_fields import state_fields, terms_fields
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.ros.policies import ZERO, CheckedPolicy, Fit
from rl_cbf_clf_controller.task_controller import NOMINAL, ORACLE, TaskController


class Answerer(ABC):
    """`built_in`: its controllers or policies by name; `fit`: what it makes of a policy's file."""

    built_in: dict[str, CheckedPolicy]
    fit: Fit
    controller: Controller | TaskController
    is_new = True

    def begin(self, episode: Episode) -> None:
        """Another episode."""
        self.controller.reset(episode.seed)

    def follow(self, policy: Any) -> None:
        """Another policy, from the next tick on; the first one before the first tick."""
        self.controller.policy = policy
        if self.is_new:
            self.is_new = False
            self.rehearse()

    @abstractmethod
    def rehearse(self) -> None:
        """Compute a tick that does not count: the first call of a function takes longer."""

    @abstractmethod
    def act(self, state: RobotState) -> tuple[Array, str]:
        """The input (m,), and why the episode must end, or nothing; raises any error of a user's code."""

    @property
    @abstractmethod
    def output(self) -> ControllerOutput:
        """All of the last tick."""

    def state_fields(self) -> dict[str, Any]:
        """Of `ControllerState`."""
        return state_fields(self.output)

    def terms_fields(self) -> dict[str, Any] | None:
        """Of `LearnerTerms`; None: there is nothing to learn from."""
        return terms_fields(self.output) if self.output.quantities else None

    def figures(self) -> dict[str, object]:
        """For diagnostics."""
        return {}


class RabbitAnswerer(Answerer):
    """With the controller of RABBIT."""

    controller: Controller

    def __init__(self, parameters: ControllerParameters, gaits: Gaits) -> None:
        zero = ZeroPolicy(parameters.problem)
        self.built_in = {ZERO: CheckedPolicy(ZERO, "built in", zero)}
        self.fit: Fit = partial(fitted, parameters=parameters, gaits=gaits)
        self.controller = Controller(parameters, gaits, zero)

    def rehearse(self) -> None:
        """See `Answerer`."""
        self.controller.rehearse()

    def act(self, state: RobotState) -> tuple[Array, str]:
        """See `Answerer`."""
        acted = self.controller.act(state)
        return acted.torque, acted.fault

    @property
    def output(self) -> ControllerOutput:
        """See `Answerer`."""
        return self.controller.output()

    def figures(self) -> dict[str, object]:
        """See `Answerer`."""
        output = self.output
        barriers = zip(output.barrier_names, output.barriers.tolist(), strict=True)
        return {
            "ticks not answered by the chosen solver": self.controller.unanswered,
            "CLF slack": output.clf_slack,
            **{BARRIER + name: B for name, B in barriers},
        }


class TaskAnswerer(Answerer):
    """With a task's controllers, by name, and its policies."""

    controller: TaskController

    def __init__(self, task: ControlTask, policy: str) -> None:
        """`policy`: the one to begin with; raises `TaskError`."""
        if policy == ORACLE and not task.true:
            raise TaskError(f"policy oracle: expected true parameters in the task {task.name}; it has none")
        self.controller = TaskController(task)
        if ":" in policy:
            self.controller.controlling(policy)
        names = [name for name in self.controller.names if name != ORACLE or task.true]
        self.built_in = {name: CheckedPolicy(name, "built in", name) for name in names}
        self.built_in[ZERO] = self.built_in[NOMINAL]
        self.fit: Fit = self.controller.fitted

    def begin(self, episode: Episode) -> None:
        """See `Answerer`."""
        self.controller.sigma = 0.0 if math.isnan(episode.sigma) else episode.sigma
        super().begin(episode)

    def rehearse(self) -> None:
        """See `Answerer`."""
        self.act(TaskSimulation(self.controller.task).reset(0))
        self.controller.reset(0)

    def act(self, state: RobotState) -> tuple[Array, str]:
        """See `Answerer`; raises ValueError, which is a line."""
        try:
            self._output = self.controller.step(state)
        except Exception as error:  # a controller of the task's own may raise anything
            raise ValueError(fault_in_user_code(error) or str(error)) from error
        return self._output.torque, self._output.fault

    @property
    def output(self) -> ControllerOutput:
        """See `Answerer`."""
        return self._output
