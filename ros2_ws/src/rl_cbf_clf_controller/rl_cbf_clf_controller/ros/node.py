"""The controller's node: a state comes in, is held until all its tick needs is there, and is answered with a torque.

A state of an episode that is not announced yet is kept until it is: the two topics may overtake each other.
A tick needs the preview of stone `touchdowns + 1`, if one was announced; the first tick of an episode also needs the
policy that the episode names. A controller that comes in the middle of an episode says so, which ends it: it
does not know since when which leg stands. Policies are checked in another thread (`policy_loader.py`) and put in
force between two ticks; every torque says which policy made it.
"""

import math
import secrets
from array import array
from collections import deque
from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field
from rabbit_common.message_checks import MessageCounter, Refused, check_turn
from rabbit_common.priority import scheduling, take_priority
from rabbit_common.ros.checked_subscription import create_checked_subscription
from rabbit_common.ros.conversions import (
    check_episode,
    check_state,
    is_new_simulator,
    is_unknown,
    nanoseconds,
    preview_of,
)
from rabbit_common.ros.diagnostics import OK, WARN, Diagnostics, Status
from rabbit_common.ros.parameters import ParameterError, declare, follow, refuse_unknown
from rabbit_common.ros.qos import EVENT, TICK
from rabbit_common.ros.spin import run
from rabbit_description.bounded_file import FileError, read_bytes
from rabbit_description.gait import GaitError, Gaits, load_gaits
from rabbit_description.state import RobotState, StonePreview
from rabbit_msgs.msg import ControllerSettings, ControllerState, Episode, PolicySwap, RabbitState, TorqueCommand
from rabbit_msgs.msg import StonePreview as PreviewMessage
from rclpy.node import Node

from rl_cbf_clf_controller.controller import DYNAMIC, Controller
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.ros.messages import controller_state, torque_message
from rl_cbf_clf_controller.ros.policy_loader import CheckedPolicy, PolicyLoader, check
from rl_cbf_clf_controller.ros.preview_buffer import PreviewBuffer
from rl_cbf_clf_controller.scene import ControllerError
from rl_cbf_clf_controller.weights import SIZE_LIMIT, PolicyFileError, policy_path

ERRORS = (GaitError, PolicyFileError)  # of the constructor, when a file cannot be used
ZERO = "zero"
WAITING = 4  # policies kept until they are due; an episode may name an older one than the newest
REFUSED = 20  # refusals of policies kept: an episode may name one of them


class NodeParameters(BaseModel):
    """Parameters of the node besides the controller's."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    policy: str = Field(ZERO, description="policy to begin with: zero, the name of a shipped one, or a file")
    swap_at: Literal["tick", "episode", "never"] = Field(
        "tick",
        description="when published policies take effect; with never they are not heard; "
        "one loaded by service always does at the next tick",
    )
    priority: int = Field(0, ge=0, le=99, description="SCHED_FIFO priority, where permitted; 0: an ordinary process")


class ControllerNode(Node):
    """Answers states with torques."""

    def __init__(self) -> None:
        super().__init__("controller")
        self._sender = f"{self.get_fully_qualified_name()} {secrets.token_hex(8)}"[-128:]
        self._own = declare(self, NodeParameters)
        self._settings = declare(self, ControllerParameters, dynamic=DYNAMIC)
        refuse_unknown(self)
        take_priority(self._own.priority, self.get_logger().warning)
        self._gait = load_gaits(self._settings.gait)
        problem = self._settings.problem
        self._zero = CheckedPolicy(ZERO, "built in", False, ZeroPolicy(problem))
        self._in_force = (
            self._zero if self._own.policy == ZERO else first_policy(self._own.policy, self._settings, self._gait)
        )
        self._waiting: deque[CheckedPolicy] = deque(maxlen=WAITING)  # not in force yet, the newest last
        self._refused: deque[CheckedPolicy] = deque(maxlen=REFUSED)
        self._checked: deque[CheckedPolicy] = deque()  # from the other thread
        self._controller = Controller(self._settings, self._gait, self._in_force.policy or ZeroPolicy(problem))
        self._controller.rehearse()
        self._message_counter = MessageCounter()
        self._episode = Episode(sigma=math.nan)
        self._previews, self._since = PreviewBuffer(), -1  # ns: when the newest state was decided
        self._held: RabbitState | None = None
        self._early: RabbitState | None = None  # of an episode that is not announced yet
        self._turn = (0, -1)  # episode and tick of the newest state
        self._answer: TorqueCommand | None = None  # to it
        self._connect()
        follow(self, self._settings, self._on_parameters)
        chosen = f"{self._settings.controller}, gait {self._gait.name}"
        self.get_logger().info(f"ready: {chosen}, policy {self._in_force.version}")

    def close(self) -> None:
        """End the thread that checks policies."""
        self._intake.close()

    def _connect(self) -> None:
        self._torques = self.create_publisher(TorqueCommand, "torque", TICK)
        self._details = self.create_publisher(ControllerState, "controller_state", TICK)
        self._swaps = self.create_publisher(PolicySwap, "policy_swap", EVENT)
        self._told_settings = self.create_publisher(ControllerSettings, "controller_settings", EVENT)
        self._states = create_checked_subscription(self, RabbitState, "state", self._on_state, TICK, self._refuse)
        create_checked_subscription(self, PreviewMessage, "preview", self._on_preview, EVENT, self._refuse)
        create_checked_subscription(self, Episode, "episode", self._on_episode, EVENT, self._refuse)
        self._diagnostics = Diagnostics(self, self._message_counter, self._status)
        self._tell_swap(self._in_force)
        self._tell_settings()
        hears_published = self._own.swap_at != "never"
        self._intake = PolicyLoader(self, self._settings, self._gait, self._on_checked, hears_published)

    # What comes in

    def _on_state(self, message: RabbitState) -> None:
        turn = (message.episode, message.tick)
        if turn == self._turn:
            self._repeat()
            return
        try:
            unknown = message.running and is_unknown(message)
            check_state(message, finite=message.running and not unknown)
            if message.episode > self._episode.episode:
                self._early = message
                return
            if self._is_in_the_middle(message):
                self._turn, self._held, self._early = turn, None, None
                self._give_up(message, f"the controller came in at tick {message.tick}, in the middle of the episode")
                return
            self._check_turn(message)
        except Refused as error:
            self._refuse("state", error)
            return
        self._turn, self._held, self._early = turn, message if message.running else None, None
        self._answer = None
        if unknown:
            self._held = None
            self._give_up(message, f"the state of tick {message.tick} is not known: see the estimator's log")
            return
        if not message.running:
            self._message_counter.accept("state")
        self._go_on()

    def _check_turn(self, message: RabbitState) -> None:
        """The next tick, or the first one of the announced episode."""
        turn = (message.episode, message.tick)
        begins = message.tick == 0 and self._turn[0] < message.episode == self._episode.episode
        check_turn(turn, turn if begins else (self._turn[0], self._turn[1] + 1))

    def _is_in_the_middle(self, message: RabbitState) -> bool:
        """Of the announced episode, of which no tick was heard yet."""
        return message.running and message.tick > 0 and self._turn[0] < message.episode == self._episode.episode

    def _repeat(self) -> None:
        """The simulator has not heard the answer: say it again, if there is one."""
        self._message_counter.accept("state again")
        if self._answer is not None:
            self._torques.publish(self._answer)

    def _on_preview(self, message: PreviewMessage) -> None:
        try:
            self._previews.add(message.episode, preview_of(message), nanoseconds(message.stamp), self._turn[0])
        except Refused as error:
            self._refuse("preview", error)
            return
        self._message_counter.accept("preview")
        self._go_on()

    def _on_episode(self, message: Episode) -> None:
        try:
            check_episode(message, self._turn[0])
        except Refused as error:
            self._refuse("episode", error)
            return
        self._message_counter.accept("episode")
        if is_new_simulator(message) and self._turn[0] > 0:
            self._turn, self._held, self._previews, self._since = (0, -1), None, PreviewBuffer(), -1
        self._episode = message
        if self._early is not None and self._early.episode == message.episode:
            early, self._early = self._early, None
            self._on_state(early)
        self._go_on()

    def _on_checked(self, checked: CheckedPolicy) -> None:
        """Called in the other thread."""
        self._checked.append(checked)
        if self.executor is not None:
            self.executor.create_task(self._go_on)

    # The tick

    def _go_on(self) -> None:
        self._take_checked()
        message = self._held
        if message is None:
            return
        if self._missing(message):
            if refusal := self._refusal(message):
                self._held = None
                self._give_up(message, refusal)
            return
        self._held = None
        state = RobotState.of_message(message, self._preview(message))
        self._since = nanoseconds(message.stamp)
        self._message_counter.accept("state")
        if message.tick == 0:
            self._begin()
        self._swap(message.tick)
        try:
            output = self._controller.step(state)
        except ValueError as error:
            self._give_up(message, str(error))
            return
        self._say(torque_message(output, message.episode, message.stamp, self._sender))
        if self._details.get_subscription_count():
            self._details.publish(controller_state(output, message.episode, message.stamp, self._sender))

    def _say(self, answer: TorqueCommand) -> None:
        self._answer = answer
        self._torques.publish(answer)

    def _missing(self, message: RabbitState) -> str:
        """What this tick still waits for; empty when it can be made."""
        if message.previewed and self._preview(message) is None:
            return f"preview of stone {message.touchdowns + 1}"
        if message.tick > 0:
            return ""
        wanted = self._wanted()
        return "" if not wanted or self._here(wanted) else f"policy {wanted}"

    def _preview(self, message: RabbitState) -> StonePreview | None:
        """Of the stone that this tick steps to."""
        stone, now = message.touchdowns + 1, nanoseconds(message.stamp)
        return self._previews.get(message.episode, stone, self._since, now)

    def _refusal(self, message: RabbitState) -> str:
        """Why the policy that this tick waits for cannot come; empty when it may."""
        wanted = self._wanted() if message.tick == 0 else ""
        refused = [d.reason for d in self._refused if d.version == wanted]
        return f"policy {wanted} was refused: {refused[-1]}" if refused else ""

    def _begin(self) -> None:
        self._set_parameters(self._settings)
        self._controller.reset(self._episode.seed)

    def _give_up(self, message: RabbitState, reason: str) -> None:
        """Answer with a fault: the simulator ends the episode under this reason."""
        self.get_logger().error(reason)
        self._say(
            TorqueCommand(
                stamp=message.stamp,
                episode=message.episode,
                tick=message.tick,
                torque=np.zeros(4),
                policy_version=self._in_force.version,
                fault=reason[:128],
                sender=self._sender,
            )
        )

    # Policies and parameters, between two ticks

    def _take_checked(self) -> None:
        while self._checked:
            checked = self._checked.popleft()
            if checked.policy is None:
                if checked.version:
                    self._refused.append(checked)
                self._refuse("policy", Refused("not fit", f"{checked.source}: {checked.reason}"))
                self._tell_swap(checked)
            else:
                self._message_counter.accept("policy")
                self._waiting.append(checked)

    def _wanted(self) -> str:
        """The policy that the episode names; empty: any."""
        return "" if self._own.swap_at == "never" else str(self._episode.policy_version)

    def _here(self, version: str) -> CheckedPolicy | None:
        return next((d for d in (self._zero, self._in_force, *self._waiting) if d.version == version), None)

    def _swap(self, tick: int) -> None:
        """Put in force what is due at this tick; what came before it is due no more."""
        wanted = self._wanted() if tick == 0 else ""
        due = [d for d in self._waiting if d.by_operator or self._own.swap_at == "tick" or tick == 0]
        new = self._here(wanted) if wanted else due[-1] if due else None
        while new in self._waiting:
            self._waiting.popleft()
        if new and new.policy and new.version != self._in_force.version:
            self._in_force, self._controller.policy = new, new.policy
            self._tell_swap(new)
            since = f"from tick {tick} of episode {self._turn[0]} on"
            self.get_logger().info(f"policy {new.version} of {new.source} in force {since}")

    def _tell_swap(self, checked: CheckedPolicy) -> None:
        self._swaps.publish(
            PolicySwap(
                episode=max(self._turn[0], 0),
                tick=max(self._turn[1], 0),
                version=checked.version,
                source=checked.source[-128:],
                accepted=checked.policy is not None,
                reason=checked.reason,
                data=array("B", checked.data),
                sender=self._sender,
            )
        )

    def _on_parameters(self, parameters: ControllerParameters) -> None:
        """An operator changed one: it holds from the next answer on."""
        try:
            self._set_parameters(parameters)
        except ControllerError as error:
            raise ParameterError(str(error)) from error
        self._tell_settings()

    def _tell_settings(self) -> None:
        """From which tick the present parameters hold."""
        episode, tick = self._turn
        settings = ControllerSettings(parameters=self._settings.model_dump_json(), gait=self._gait.model_dump_json())
        settings.episode, settings.tick = episode, tick + (self._held is None)
        settings.sender = self._sender
        self._told_settings.publish(settings)

    def _set_parameters(self, parameters: ControllerParameters) -> None:
        """The episode's own sigma goes before the node's."""
        sigma = parameters.sigma if math.isnan(self._episode.sigma) else self._episode.sigma
        self._controller.parameters = parameters.model_copy(update={"sigma": sigma})
        self._settings = parameters

    def _refuse(self, topic: str, error: Refused) -> None:
        self.get_logger().warning(self._message_counter.refuse(topic, error), throttle_duration_sec=1.0)

    def _status(self) -> Status:
        figures = {
            "policy": self._in_force.version,
            "policy waiting": self._waiting[-1].version if self._waiting else "",
            "ticks not answered by the chosen solver": self._controller.unanswered,
            "scheduling": scheduling(),
            "walked by": self._episode.controller,
        }
        if not self._states.get_publisher_count():
            return WARN, "waiting for a simulator", figures
        if self._early:
            return WARN, f"waits for the announcement of episode {self._early.episode}", figures
        if missing := self._missing(self._held) if self._held else "":
            return WARN, f"tick {self._turn[1]} of episode {self._turn[0]} waits for the {missing}", figures
        return OK, f"episode {self._turn[0]}", figures


def first_policy(name: str, parameters: ControllerParameters, gaits: Gaits) -> CheckedPolicy:
    """The shipped policy of this name, or the file; raises `PolicyFileError`."""
    try:
        checked = check(read_bytes(policy_path(name), SIZE_LIMIT), name, parameters, gaits)
    except FileError as error:
        raise PolicyFileError(f"policy {name}: neither a shipped one nor a file: {error}") from error
    if checked.policy is None:
        raise PolicyFileError(f"policy {name}: {checked.reason}")
    return checked


def main() -> None:
    """The executable `controller`."""
    run(ControllerNode, errors=ERRORS)


if __name__ == "__main__":
    main()
