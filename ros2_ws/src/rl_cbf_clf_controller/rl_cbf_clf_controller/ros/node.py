"""The controller's node: a state comes in, is held until all its tick needs is there, and is answered with a torque.

A tick of RABBIT needs the preview of stone `touchdowns + 1`, if one was announced; one of a task that is commanded its
`parameters`; the first tick of an episode also needs the policy that the episode names. A controller of RABBIT that
comes in the middle of an episode says so, which ends it: it does not know since when which leg stands. A task has no
such memory. Policies are put in force between two ticks; every torque says which policy made it.
"""

import math
import secrets

import numpy as np
from pydantic import Field
from rabbit_common.guard import reason_of
from rabbit_common.message_checks import Refused, doubles
from rabbit_common.priority import scheduling, take_priority
from rabbit_common.ros.diagnostics import OK, WARN, Diagnostics, Status
from rabbit_common.ros.parameters import ParameterError, declare, follow, refuse_unknown
from rabbit_common.ros.qos import EVENT, TICK
from rabbit_common.ros.simulator_follower import SimulatorFollower
from rabbit_common.ros.spin import run
from rabbit_description import ABOUT_TASK
from rabbit_description.gait import GaitError, load_gaits
from rabbit_description.state import Array
from rabbit_description.task import TaskError
from rabbit_description.task_source import load_task
from rabbit_msgs import msg

from rl_cbf_clf_controller.controller import DYNAMIC
from rl_cbf_clf_controller.kinds import ControllerName
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.ros import policies
from rl_cbf_clf_controller.ros.answerers import Answerer, RabbitAnswerer, TaskAnswerer
from rl_cbf_clf_controller.ros.tick_intake import TickIntake
from rl_cbf_clf_controller.scene import ControllerError
from rl_cbf_clf_controller.uncertainty import RL_CBF_CLF_QP
from rl_cbf_clf_controller.weights import PolicyFileError


class NodeParameters(policies.NodeParameters):
    """What is controlled, and with which policies."""

    task: str = Field("", description=f"what is controlled; empty: RABBIT; else {ABOUT_TASK}")


class Settings(ControllerParameters):
    """The controller's settings. A node that names no controller gets the one that a trainer's policies belong to."""

    controller: ControllerName = Field(
        RL_CBF_CLF_QP.name, description=ControllerParameters.model_fields["controller"].description
    )


class ControllerNode(SimulatorFollower):
    """Answers states with torques."""

    def __init__(self) -> None:
        super().__init__("controller")
        self._sender = f"{self.get_fully_qualified_name()} {secrets.token_hex(8)}"[-128:]
        parameters = declare(self, NodeParameters)
        self._settings: ControllerParameters | None = None  # RABBIT's
        answerer: Answerer
        if not parameters.task:
            self._settings = declare(self, Settings, dynamic=DYNAMIC)
        refuse_unknown(self)
        take_priority(parameters.priority, self.get_logger().warning)
        if self._settings:
            self._gait = load_gaits(self._settings.gait)
            self._rabbit = answerer = RabbitAnswerer(self._settings, self._gait)
            self._ticks = TickIntake(self._settings.tick_seconds)
            what = f"{self._settings.controller}, gait {self._gait.name}"
        else:
            task = load_task(parameters.task)
            answerer = TaskAnswerer(task, parameters.policy)
            self._ticks = TickIntake(task.seconds, task)
            what = f"task {task.name}"
        self._answerer = answerer
        self._policies = policies.Policies(self, parameters, answerer.built_in, answerer.fit, self._sender, self._go_on)
        answerer.follow(self._policies.in_force.policy)
        self.close = self._policies.close
        self._begun = 0  # the newest episode
        self._answer = msg.TorqueCommand(sender=self._sender)  # the newest
        self._torques = self.create_publisher(msg.TorqueCommand, "torque", TICK)
        self._details = self.create_publisher(msg.ControllerState, "controller_state", TICK)
        self._terms = self.create_publisher(msg.LearnerTerms, "learner_terms", TICK)
        self._states = self._hear_simulator(msg.RobotState, "state", self._on_state, TICK)
        if self._settings:
            self._hear_simulator(msg.StonePreview, "preview", self._on_preview, EVENT)
            self._told_settings = self.create_publisher(msg.ControllerSettings, "controller_settings", EVENT)
        else:
            self._hear_simulator(msg.TaskParameters, "parameters", self._on_task_parameters, TICK)
        self._hear_simulator(msg.Episode, "episode", self._on_episode, EVENT)
        self._diagnostics = Diagnostics(self, self._message_counter, self._status)
        if self._settings:
            self._tell_settings(self._settings)
            follow(self, self._settings, self._on_parameters)
        self.get_logger().info(f"ready: {what}, policy {self._policies.in_force.version}")

    # What comes in

    def _on_state(self, message: msg.RobotState) -> None:
        if (message.episode, message.tick) == self._ticks.turn:  # the simulator has not heard the answer
            self._message_counter.accept("state again")
            if (self._answer.episode, self._answer.tick) == self._ticks.turn:
                self._torques.publish(self._answer)
            return
        fault = self._ticks.take(message)
        if fault:
            self._give_up(message, fault)
        elif fault is not None:
            if not message.running:
                self._message_counter.accept("state")
            self._go_on()

    def _on_preview(self, message: msg.StonePreview) -> None:
        self._ticks.keep_preview(message)
        self._message_counter.accept("preview")
        self._go_on()

    def _on_task_parameters(self, message: msg.TaskParameters) -> None:
        self._ticks.keep_parameters(message)
        self._message_counter.accept("parameters")
        self._go_on()

    def _on_episode(self, message: msg.Episode) -> None:
        early = self._ticks.announce(message)
        self._message_counter.accept("episode")
        if early is not None:
            try:
                self._on_state(early)
            except Refused as error:
                self._refuse("state", error)
        self._go_on()

    # The tick

    def _go_on(self) -> None:
        self._policies.take(self._ticks.turn, self._message_counter.accept, self._refuse)
        message = self._ticks.held
        if message is None:
            return
        if self._missing(message):
            if refusal := self._policies.refusal(self._named(message)):
                self._ticks.held = None
                self._give_up(message, refusal)
            return
        state = self._ticks.complete(message)
        self._message_counter.accept("state")
        if message.tick == 0 or message.episode != self._begun:
            self._begun = message.episode
            if self._settings:
                self._set_parameters(self._settings)
            self._answerer.begin(self._ticks.episode)
        if policy := self._policies.swap(self._ticks.turn, self._named(message)):
            self._answerer.follow(policy)
        try:
            acted = self._answerer.act(state)
        except Exception as error:  # a barrier, a solver or a task may be another package's
            self._give_up(message, reason_of(error))
            return
        self._say(message, acted.torque, acted.fault)
        head = {"header": message.header, "episode": message.episode, "tick": message.tick, "sender": self._sender}
        if self._details.get_subscription_count():  # while the simulator steps
            self._details.publish(msg.ControllerState(**head, **self._answerer.state_fields()))
        if self._terms.get_subscription_count() and (terms := self._answerer.terms_fields()):
            self._terms.publish(msg.LearnerTerms(**head, **terms))

    def _say(self, answered: msg.RobotState, torque: Array, fault: str) -> None:
        answer = self._answer
        answer.header, answer.episode, answer.tick = answered.header, answered.episode, answered.tick
        answer.torque, answer.fault = doubles(torque), fault[:128]
        answer.policy_version = self._policies.in_force.version[:64]
        self._torques.publish(answer)

    def _give_up(self, message: msg.RobotState, reason: str) -> None:
        """Answer with a fault: the simulator ends the episode under this reason."""
        self.get_logger().error(reason)
        self._say(message, np.zeros(len(message.applied)), reason)

    def _missing(self, message: msg.RobotState) -> str:
        """What this tick still waits for; empty when it can be made."""
        return self._ticks.missing(message) or self._policies.missing(self._named(message))

    def _named(self, message: msg.RobotState) -> str:
        """The policy that the episode names for this tick, its first; empty: any."""
        is_first = message.tick == 0 and self._policies.hears_published
        return str(self._ticks.episode.policy_version) if is_first else ""

    def _on_parameters(self, parameters: ControllerParameters) -> None:
        """An operator changed one: it holds from the next answer on."""
        try:
            self._set_parameters(parameters)
        except ControllerError as error:
            raise ParameterError(str(error)) from error
        self._tell_settings(parameters)

    def _tell_settings(self, parameters: ControllerParameters) -> None:
        """Publishes the tick from which the present parameters hold."""
        episode, tick = self._ticks.turn
        turn = {"episode": episode, "tick": tick + (self._ticks.held is None)}
        texts = {"parameters": parameters.model_dump_json(), "gait": self._gait.model_dump_json()}
        self._told_settings.publish(msg.ControllerSettings(**turn, **texts, sender=self._sender))

    def _set_parameters(self, parameters: ControllerParameters) -> None:
        """The episode's sigma goes before the node's."""
        sigma = self._ticks.episode.sigma
        sigma = parameters.sigma if math.isnan(sigma) else sigma
        self._rabbit.controller.parameters = parameters.model_copy(update={"sigma": sigma})
        self._settings = parameters

    def _status(self) -> Status:
        ticks = self._ticks
        episode, tick = ticks.turn
        figures = {
            "policy": self._policies.in_force.version,
            "policy waiting": self._policies.newest,
            "scheduling": scheduling(),
            "walked by": ticks.episode.controller,
            **self._answerer.figures(),
        }
        if not self._states.get_publisher_count():
            return WARN, "waiting for a simulator", figures
        if ticks.early:
            return WARN, f"waits for the announcement of episode {ticks.early.episode}", figures
        if missing := self._missing(ticks.held) if ticks.held else "":
            return WARN, f"tick {tick} of episode {episode} waits for the {missing}", figures
        return OK, f"episode {episode}", figures


def main() -> None:
    """The executable `controller`."""
    run(ControllerNode, errors=(GaitError, PolicyFileError, TaskError))
