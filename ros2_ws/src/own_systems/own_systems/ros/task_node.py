"""What the controllers of tasks share: the task, its policies, swapped between two ticks, and what is told of it."""

import secrets
from typing import Any

import numpy as np
from cbf_clf_qp.functions import Array
from pydantic import Field
from rabbit_common.message_checks import Refused
from rabbit_common.priority import take_priority
from rabbit_common.ros.diagnostics import Diagnostics, Status
from rabbit_common.ros.parameters import declare, refuse_unknown
from rabbit_common.ros.qos import TICK
from rabbit_common.ros.simulator_follower import SimulatorFollower
from rabbit_description.user_code import fault_in_user_code
from rabbit_msgs import msg
from rl_cbf_clf_controller.ros import policies
from rl_cbf_clf_controller.weights import PolicyFileError

from own_systems.episode import NOMINAL, ORACLE, Moment, Rider, beginning
from own_systems.loading import load_task
from own_systems.messages import controller_fields, terms_fields
from own_systems.task import ControlTask, TaskError

ERRORS = (TaskError, PolicyFileError)
TASK = "a Python file with a ControlTask, a walker's .yaml, or what an installed package brings, by its name"


class NodeParameters(policies.NodeParameters):
    """Which task, and which of its controllers begins."""

    task: str = Field("", description=TASK)
    policy: str = Field(NOMINAL, description="nominal, oracle, one of the task's own, KIND:FILE, or a policy's file")


class TaskNode(SimulatorFollower):
    """Decides ticks of a task. `tick`: the turn, an episode and its tick, that is decided next or was the last."""

    PARAMETERS = NodeParameters

    def __init__(self) -> None:
        """Raises `ERRORS`, or `ParameterError`."""
        super().__init__("controller")
        self._sender = f"{self.get_fully_qualified_name()} {secrets.token_hex(8)}"[-128:]
        self._own = declare(self, self.PARAMETERS)
        refuse_unknown(self)
        take_priority(self._own.priority, self.get_logger().warning)
        self.task = load_task(self._own.task)
        if self._own.policy == ORACLE and not self.task.true:
            raise TaskError(f"policy oracle: expected true parameters in the task {self.task.name}; it has none")
        self._rider = Rider(self._ridden(self.task))
        name = self._own.policy
        if ":" in name:
            self._rider.controlling(name)
        names = [each for each in self._rider.names if each != ORACLE or self.task.true]
        built_in = {each: policies.CheckedPolicy(each, "built in", each) for each in names}
        built_in[policies.ZERO] = built_in[NOMINAL]
        self._policies = policies.Policies(self, self._own, built_in, self._rider.fitted, self._sender, self._go_on)
        self.close = self._policies.close
        self._controlling = self._policies.in_force.policy
        self._rider.begin(self._controlling)
        x, commands, _ = beginning(self._rider.task, 0)  # a rehearsal: the first call of a function takes longer
        self._rider.moment(self._controlling, 0.0, x, self._rider.task.parameters_at({}, commands(0.0)), np.zeros(1))
        self._details = self.create_publisher(msg.ControllerState, "controller_state", TICK)
        self._terms = self.create_publisher(msg.LearnerTerms, "learner_terms", TICK)
        self._diagnostics = Diagnostics(self, self._message_counter, self._status)
        self.get_logger().info(f"ready: task {self.task.name}, policy {self._policies.in_force.version}")

    def _ridden(self, task: ControlTask) -> ControlTask:
        """The task that is decided in its place."""
        return task

    def _go_on(self) -> None:
        """Something came: a policy may be due."""
        raise NotImplementedError

    def _status(self) -> Status:
        raise NotImplementedError

    def _take_policies(self, turn: tuple[int, int]) -> None:
        self._policies.take(turn, self._message_counter.accept, self._refuse)

    def _decide(self, turn: tuple[int, int], named: str, x: Array, p: Array, noise: Array) -> Moment:
        """The tick at a state, under the policy that is due; `named`: the one that the episode names, or empty.

        Raises ValueError: no answer, which is a line.
        """
        if policy := self._policies.swap(turn, named):
            self._controlling = policy
            self._rider.begin(policy)
        self._rider.ticks.interrupt()  # nothing is learned here
        try:
            moment = self._rider.moment(self._controlling, turn[1] * self.task.seconds, x, p, noise)
        except Exception as error:  # a controller of the task's own may raise anything
            raise ValueError(fault_in_user_code(error) or str(error)) from error
        if moment.decided is not None and not moment.decided.solved:
            raise ValueError(f"no solver answered: {moment.decided.status}")
        if not np.isfinite(moment.u).all():
            raise ValueError(f"u = {moment.u}: expected finite numbers")
        return moment

    def _tell(self, head: dict[str, Any], moment: Moment) -> None:
        """What acts in this tick, to those who read it."""
        version = self._policies.in_force.version
        if self._details.get_subscription_count():
            fields = controller_fields(self._rider.task, moment, version)
            self._details.publish(msg.ControllerState(**head, **fields))
        if self._terms.get_subscription_count() and moment.decided is not None:
            self._terms.publish(msg.LearnerTerms(**head, **terms_fields(self._rider.task, moment)))


def check_layout(message: msg.Episode, layout: dict[str, Any]) -> None:
    """Refuse the announcement of another system's episode; names that are left out may be any."""
    for name, own in layout.items():
        if (got := list(getattr(message, name))) not in ([], own):
            raise Refused("another system", f"{name} = {', '.join(got[:8])}; expected {', '.join(own)}")
