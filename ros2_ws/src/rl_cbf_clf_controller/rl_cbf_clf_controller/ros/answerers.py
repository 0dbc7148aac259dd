"""Who answers the states that the controller's node takes in: RABBIT's controller, or a control task's."""

import math
from functools import partial
from typing import Any

from rabbit_common.ros.diagnostics import BARRIER
from rabbit_description.gait import Gaits
from rabbit_description.state import RobotState
from rabbit_description.task import ControlTask, TaskError
from rabbit_description.user_code import fault_in_user_code
from rabbit_msgs.msg import Episode

from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.controller_output import Acted, ControllerOutput
from rl_cbf_clf_controller.fitted_policy import fitted
from rl_cbf_clf_controller.message_fields import state_fields, terms_fields
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.ros.policies import ZERO, CheckedPolicy, Fit
from rl_cbf_clf_controller.task_controller import NOMINAL, ORACLE, TaskController


class Answerer:
    """Answers with a controller. `built_in`: its policies by name; `fit`: what it makes of a policy's file."""

    controller: Controller | TaskController
    built_in: dict[str, CheckedPolicy]
    fit: Fit
    is_new = True

    def begin(self, episode: Episode) -> None:
        """Another episode."""
        self.controller.reset(episode.seed)

    def follow(self, policy: Any) -> None:
        """Another policy, from the next tick on; the first one before the first tick."""
        self.controller.policy = policy
        if self.is_new:
            self.is_new = False
            self.controller.rehearse()

    def act(self, state: RobotState) -> Acted | ControllerOutput:
        """What acts: of a user's code any error may be raised."""
        return self.controller.act(state)

    def state_fields(self) -> dict[str, Any]:
        """The fields of `ControllerState`."""
        return state_fields(self.controller.output())

    def terms_fields(self) -> dict[str, Any] | None:
        """The fields of `LearnerTerms`; None: there is nothing to learn from."""
        output = self.controller.output()
        return terms_fields(output) if output.quantities else None

    def figures(self) -> dict[str, object]:
        """The figures for diagnostics."""
        return {}


class RabbitAnswerer(Answerer):
    """Answers with the controller of RABBIT."""

    controller: Controller

    def __init__(self, parameters: ControllerParameters, gaits: Gaits) -> None:
        zero = ZeroPolicy(parameters.problem)
        self.built_in = {ZERO: CheckedPolicy(ZERO, "built in", zero)}
        self.fit: Fit = partial(fitted, parameters=parameters, gaits=gaits)
        self.controller = Controller(parameters, gaits, zero)

    def figures(self) -> dict[str, object]:
        output = self.controller.output()
        barriers = zip(output.barrier_names, output.barriers.tolist(), strict=True)
        return {
            "ticks not answered by the chosen solver": self.controller.unanswered,
            "CLF slack": output.clf_slack,
            **{BARRIER + name: B for name, B in barriers},
        }


class TaskAnswerer(Answerer):
    """Answers with a task's controllers, by name, and policies."""

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
        self.controller.sigma = 0.0 if math.isnan(episode.sigma) else episode.sigma
        super().begin(episode)

    def act(self, state: RobotState) -> Acted | ControllerOutput:
        """What a controller that a task brings raises becomes a ValueError of one line."""
        try:
            return super().act(state)
        except Exception as error:
            raise ValueError(fault_in_user_code(error) or str(error)) from error
