"""The controller of a task in lock-step: `state` and `parameters` of a tick come in, in any order; `torque` goes out.

A tick waits for the announcement of its episode and, where the task has commands, for the parameters of the same
tick. A controller may come in at any tick: a task has no memory. Policies are put in force between two ticks.
"""

import math

import numpy as np
from cbf_clf_qp.functions import Array
from rabbit_common.guard import reason_of
from rabbit_common.message_checks import Refused, doubles
from rabbit_common.ros.conversions import is_new_simulator, other_tick
from rabbit_common.ros.diagnostics import OK, WARN, Status
from rabbit_common.ros.qos import EVENT, TICK
from rabbit_common.ros.spin import run
from rabbit_msgs import msg

from own_systems.episode import beginning
from own_systems.messages import layout_fields, parameters_of, state_of
from own_systems.ros.task_node import ERRORS, TaskNode, check_layout

NEVER = (0, -1)  # a turn before the first


class ControllerNode(TaskNode):
    """Answers states with torques."""

    def __init__(self) -> None:
        super().__init__()
        self._turn = NEVER  # of the newest state
        self._held: tuple[msg.RobotState, Array] | None = None  # that waits
        self._p = NEVER, None if self.task.commanded else self.task.parameters_at({}, {})  # with the turn they are of
        self._episode = msg.Episode(sigma=math.nan)
        self._exploring = np.random.default_rng(0)
        self._answer: msg.TorqueCommand | None = None  # the newest
        self._torques = self.create_publisher(msg.TorqueCommand, "torque", TICK)
        self._states = self._hear_simulator(msg.RobotState, "state", self._on_state, TICK)
        self._hear_simulator(msg.TaskParameters, "parameters", self._on_parameters, TICK)
        self._hear_simulator(msg.Episode, "episode", self._on_episode, EVENT)

    # What comes in

    def _on_state(self, message: msg.RobotState) -> None:
        turn, announced = (message.episode, message.tick), self._episode.episode
        was_led_ahead = message.episode == announced < self._turn[0]  # by a state of an episode that nobody announced
        if turn < self._turn and not was_led_ahead:
            raise Refused("late", f"tick {turn[1]} of episode {turn[0]}; expected {self._turn} or a later one")
        if turn == self._turn:  # the simulator has not heard the answer
            self._message_counter.accept("state again")
            if self._answer is not None and (self._answer.episode, self._answer.tick) == turn:
                self._torques.publish(self._answer)
            return
        self._held = (message, state_of(self.task, message)) if message.running else None  # the last may be anything
        self._turn = turn
        self._message_counter.accept("state")
        self._go_on()

    def _on_parameters(self, message: msg.TaskParameters) -> None:
        p = parameters_of(self.task, message)
        self._message_counter.accept("parameters")
        self._p = (message.episode, message.tick), p
        self._go_on()

    def _on_episode(self, message: msg.Episode) -> None:
        check_layout(message, layout_fields(self.task))
        if is_new_simulator(message) and self._turn != NEVER:
            self._turn, self._held = NEVER, None
        if message.episode != self._episode.episode:
            self._exploring = beginning(self.task, message.seed)[2]
        self._episode = message
        self._message_counter.accept("episode")
        self._go_on()

    # The tick

    def _go_on(self) -> None:
        self._take_policies(self._turn)
        if self._held is None:
            return
        message, x = self._held
        if self._missing(message):
            if refusal := self._policies.refusal(self._named(message)):
                self._give_up(message, refusal)
            return
        if fault := other_tick(self._episode, self.task.seconds):
            self._give_up(message, fault)
            return
        sigma = 0.0 if math.isnan(self._episode.sigma) else self._episode.sigma
        noise = sigma * self._exploring.standard_normal(self._rider.problem.inputs)
        assert self._p[1] is not None
        try:
            moment = self._decide(self._turn, self._named(message), x, self._p[1], noise)
        except Exception as error:  # the task is a user's
            self._give_up(message, reason_of(error))
            return
        self._say(message, moment.u)
        self._tell(self._head(message), moment)

    def _say(self, message: msg.RobotState, u: Array, fault: str = "") -> None:
        said = {"policy_version": self._policies.in_force.version[:64], "fault": fault[:128]}
        self._held, self._answer = None, msg.TorqueCommand(**self._head(message), torque=doubles(u), **said)
        self._torques.publish(self._answer)

    def _give_up(self, message: msg.RobotState, reason: str) -> None:
        """Answer with a fault: the simulator ends the episode under this reason."""
        self.get_logger().error(reason)
        self._say(message, np.zeros(len(self.task.names_of_u)), reason)

    def _head(self, message: msg.RobotState) -> dict[str, object]:
        turn = {"episode": message.episode, "tick": message.tick}
        return {"header": message.header, **turn, "sender": self._sender}

    def _missing(self, message: msg.RobotState) -> str:
        """What this tick still waits for; empty when it can be made."""
        if self._episode.episode != message.episode:
            return f"announcement of episode {message.episode}"
        if self.task.commanded and self._p[0] != self._turn:
            return "parameters"
        return self._policies.missing(self._named(message))

    def _named(self, message: msg.RobotState) -> str:
        """The policy that the episode names for its first tick; empty: any."""
        is_first = message.tick == 0 and self._policies.hears_published
        return str(self._episode.policy_version) if is_first else ""

    def _status(self) -> Status:
        figures = {"policy": self._policies.in_force.version, "policy waiting": self._policies.newest}
        if not self._states.get_publisher_count():
            return WARN, "waiting for a simulator", figures
        if missing := self._missing(self._held[0]) if self._held else "":
            return WARN, f"tick {self._turn[1]} of episode {self._turn[0]} waits for the {missing}", figures
        return OK, f"episode {self._turn[0]}", figures


def main() -> None:
    """The executable `controller`."""
    run(ControllerNode, errors=ERRORS)
