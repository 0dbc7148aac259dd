"""Simulates a task's robot and its drivers: it moves by the wall clock under the newest command.

    commands       std_msgs/Float64MultiArray   in, the input u (m,), which holds until the next one; 0 before the first
    joint_states   sensor_msgs/JointState       out, by the names of the task's coordinates
    parameters     rabbit_msgs/TaskParameters   out, where the task has commands

An episode begins once somebody hears the joints, and the next one as it ends.
"""

import numpy as np
from pydantic import Field
from rabbit_common.message_checks import array_of, check_finite
from rabbit_common.ros.checked_node import CheckedNode
from rabbit_common.ros.conversions import header
from rabbit_common.ros.diagnostics import OK, WARN, Diagnostics, Status
from rabbit_common.ros.parameters import declare, refuse_unknown
from rabbit_common.ros.qos import TICK
from rabbit_common.ros.spin import run, steady_timer
from rabbit_description import ABOUT_TASK
from rabbit_description.state import RobotState
from rabbit_description.task import TaskError
from rabbit_description.task_simulation import TaskSimulation
from rabbit_description.task_source import load_task
from rabbit_description.validation import Checked
from std_msgs.msg import Float64MultiArray

from rabbit_sim.ros.publishers import TaskPublishers


class NodeParameters(Checked):
    """Which task, and its first seed."""

    task: str = Field("", description=ABOUT_TASK)
    seed: int = Field(1, ge=0, le=2**63 - 1, description="seed of the first episode; the next ones count up from it")


class TaskRobotNode(CheckedNode):
    """Moves on under the newest command."""

    def __init__(self) -> None:
        super().__init__("robot")
        parameters = declare(self, NodeParameters)
        refuse_unknown(self)
        self._simulation = TaskSimulation(load_task(parameters.task))
        self._topics = TaskPublishers(self, self._simulation.task, self.get_name())
        self._u = np.zeros(len(self._simulation.layout.joints))
        self._state: RobotState | None = None  # None: nobody has heard it yet
        self._seed, self._episode, self._ticks = parameters.seed, 0, 0
        self._hear(Float64MultiArray, "commands", self._on_command, TICK)
        self._diagnostics = Diagnostics(self, self._message_counter, self._status)
        steady_timer(self, self._simulation.tick_seconds, self._tick)

    def _on_command(self, message: Float64MultiArray) -> None:
        u = array_of(message, "data", len(self._u))
        check_finite("commands", u.tolist())
        self._u = u
        self._message_counter.accept("commands")

    def _tick(self) -> None:
        if self._state is None or not self._state.running:
            if self._state is None and not self._topics.is_heard:
                return
            self._u = np.zeros_like(self._u)
            self._state = self._simulation.reset(self._seed + self._episode)
            self._episode += 1
        else:
            self._state = self._simulation.step(self._u)
        self._topics.tick(self._state, self._episode, header(self._ticks, self._simulation.tick_seconds))
        self._ticks += 1

    def _status(self) -> Status:
        figures = {"episode": self._episode, "ticks": self._ticks}
        if self._state is None:
            return WARN, "waiting for readers of joint_states", figures
        return OK, f"episode {self._episode}", figures


def main() -> None:
    """The executable `robot`."""
    run(TaskRobotNode, errors=(TaskError,))
