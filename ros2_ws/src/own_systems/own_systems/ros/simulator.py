"""The true system of a task: seeded episodes, `state` and `parameters` of each tick, and a step under its answer.

In lock-step nothing moves before the `torque` of the very tick has come. In real time it stands in for a robot behind
ros2_control: it moves on under the newest `commands`, and says `joint_states`.
"""

from typing import Any, Literal

import numpy as np
from builtin_interfaces.msg import Time
from cbf_clf_qp.functions import Array
from pydantic import BaseModel, ConfigDict, Field
from rabbit_common.message_checks import Refused, array_of, check_finite, check_turn
from rabbit_common.ros.checked_node import CheckedNode
from rabbit_common.ros.conversions import check_plan
from rabbit_common.ros.diagnostics import OK, WARN, Diagnostics, Status
from rabbit_common.ros.parameters import declare, refuse_unknown
from rabbit_common.ros.qos import EVENT, TICK
from rabbit_common.ros.spin import run, steady_timer
from rabbit_msgs import msg
from rabbit_sim.ros.live_controllers import LOOK_SECONDS, ControllerAdmission, Wait
from rabbit_sim.ros.other_simulators import OtherSimulators
from sensor_msgs.msg import JointState
from std_msgs.msg import Float64MultiArray, Header

from own_systems.episode import beginning
from own_systems.loading import load_task
from own_systems.messages import layout_fields, parameter_fields, state_fields
from own_systems.ros.task_node import TASK
from own_systems.task import TaskError

NONE = 2**32 - 1  # no episode


class NodeParameters(BaseModel):
    """Which task, how many episodes, and who must be there."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    task: str = Field("", description=TASK)
    seed: int = Field(1, ge=0, le=2**63 - 1, description="seed of the first episode; the next ones count up from it")
    episodes: int = Field(1, ge=1, description="after which it says no more")
    readers: int = Field(1, ge=1, le=100, description="nodes that must hear it before an episode begins")
    real_time: bool = Field(False, description="a tick lasts its time by the wall clock, under the newest `commands`")
    trainer: Literal["ignore", "follow"] = Field("ignore", description="follow: wait for its plans, and play those")
    answer_timeout: float = Field(5.0, gt=0, le=3600, description="s without a torque that end an episode")


class SimulatorNode(CheckedNode):
    """Plays episodes with whoever answers."""

    def __init__(self) -> None:
        super().__init__("simulator")
        self._own = declare(self, NodeParameters)
        refuse_unknown(self)
        self.task = load_task(self._own.task)
        self._others = OtherSimulators(self, self._claim, self._give_way)
        known = {"tick_seconds": self.task.seconds, "sender": self._others.sender, **layout_fields(self.task)}
        self._episode = msg.Episode(sigma=np.nan, **known)
        self._x: Array | None = None  # None between episodes
        self._u = np.zeros(len(self.task.names_of_u))
        self._clock_ticks = 0
        self._plan = msg.EpisodePlan(sigma=np.nan)
        self._admission, self._wait = ControllerAdmission(), Wait()
        self._episodes = self.create_publisher(msg.Episode, "episode", EVENT)
        self._commanding = self.create_publisher(msg.TaskParameters, "parameters", TICK)
        self._states = self.create_publisher(msg.RobotState, "state", TICK)
        self._joints = self.create_publisher(JointState, "joint_states", TICK)
        if self._own.real_time:
            self._hear(Float64MultiArray, "commands", self._on_command, TICK)
            steady_timer(self, self.task.seconds, self._step)
        else:
            self._torques = self._hear(msg.TorqueCommand, "torque", self._on_torque, TICK)
        if self._own.trainer == "follow":
            self._plan.after_episode = NONE
            self._hear(msg.EpisodePlan, "episode_plan", self._on_plan, EVENT)
        self._diagnostics = Diagnostics(self, self._message_counter, self._status)
        steady_timer(self, LOOK_SECONDS, self._look)
        self._announce(msg.Episode.WAITING)
        self.get_logger().info(f"ready: {self._own.episodes} episodes of {self.task.name} from seed {self._own.seed}")

    def close(self) -> None:
        """End the episode."""
        self._end("reset", "the simulator was told to end")

    # What comes in

    def _on_fault(self, reason: str) -> None:
        """Nobody knows how far the tick came: the episode is over."""
        self._end("fault", reason)

    def _on_torque(self, message: msg.TorqueCommand) -> None:
        if self._x is None:
            raise Refused("not awaited", f"episode {message.episode}, tick {message.tick}")
        self._admission.check(message.sender, is_asked_again=self._wait.reminders > 0)
        check_turn((message.episode, message.tick), (self._episode.episode, self._episode.tick))
        u = self._checked(message, "torque")
        self._message_counter.accept("torque")
        if fault := self._admission.admit(message):
            self._end("fault", fault)
            return
        self._u, self._episode.controller = u, message.sender
        self._step()

    def _on_plan(self, message: msg.EpisodePlan) -> None:
        check_plan(message, (self._episode.episode, self._episode.episode - 1))
        self._message_counter.accept("episode_plan")
        self._plan = message

    def _on_command(self, message: Float64MultiArray) -> None:
        self._u = self._checked(message, "data")
        self._message_counter.accept("commands")

    def _checked(self, message: Any, field: str) -> Array:
        u = array_of(message, field, len(self._u))
        check_finite(field, u.tolist())
        return u

    # The episode

    def _look(self) -> None:
        """Begin what can begin; ask again, or end what nobody answers."""
        self._wait.look()
        self._others.look()
        if self._x is None:
            is_open = self._episode.episode < self._own.episodes and self._others.may_play
            if is_open and self._is_heard() and self._is_planned():
                self._begin()
            elif is_open and not self._is_planned() and self._wait.is_reminder_due():
                self._announce(self._episode.phase)
        elif not self._own.real_time and self._wait.seconds > self._own.answer_timeout:
            self._end("silent", f"no torque for tick {self._episode.tick} in {self._own.answer_timeout:g} s")
        elif not self._own.real_time and self._wait.is_reminder_due():
            self._publish(running=True)

    def _is_heard(self) -> bool:
        if self._own.real_time:
            return self._joints.get_subscription_count() >= self._own.readers
        least = min(each.get_subscription_count() for each in (self._states, self._commanding))
        return least >= self._own.readers and self._torques.get_publisher_count() > 0

    def _is_planned(self) -> bool:
        return self._own.trainer == "ignore" or self._plan.after_episode == self._episode.episode

    def _begin(self) -> None:
        number, plan = self._episode.episode + 1, self._plan
        seed = self._own.seed + number - 1 if self._own.trainer == "ignore" else plan.seed
        self._episode.episode, self._episode.tick, self._episode.seed = number, 0, seed
        self._episode.sigma, self._episode.policy_version = plan.sigma, plan.policy_version
        self._episode.touchdowns, self._episode.outcome, self._episode.reason = 0, "", ""
        self._x, self._commands, _ = beginning(self.task, self._episode.seed)
        self._u = np.full(len(self._u), 0.0 if self._own.real_time else np.nan)
        self._admission.begin()
        self._announce(msg.Episode.RUNNING)
        self._publish(running=True)
        self._wait.begin()

    def _step(self) -> None:
        """A tick under the input that was answered, or, in real time, commanded last."""
        if self._x is None:
            return
        true = self.task.parameters_at(self.task.true, self._commanded())
        moved = self.task.moved(self._x, true, self._u)
        self._x = moved.x
        self._episode.tick += 1
        self._episode.touchdowns += moved.impacts
        self._clock_ticks += 1
        outcome = self.task.outcome(moved, true, self._episode.tick, self._episode.touchdowns)
        self._publish(running=not outcome)
        self._wait.begin()
        if outcome:
            failed = outcome == "failed"
            self._end(outcome, self.task.why_failed(moved, true, self._episode.touchdowns) if failed else "")

    def _end(self, outcome: str, reason: str = "") -> None:
        if self._x is not None:
            self._x, self._episode.outcome, self._episode.reason = None, outcome, reason[:128]
            self._announce(msg.Episode.ENDED)
            self.get_logger().info(f"episode {self._episode.episode}: {outcome} {reason}")
            self._wait.begin()

    def _commanded(self) -> Any:
        return self._commands(self._episode.tick * self.task.seconds)

    def _claim(self) -> None:
        self._announce(self._episode.phase)

    def _give_way(self, reason: str) -> None:
        self._end("reset", reason)

    # What goes out

    def _announce(self, phase: int) -> None:
        self._episode.phase, self._episode.header = phase, self._header()
        self._episodes.publish(self._episode)

    def _publish(self, running: bool) -> None:
        """A tick's messages; parameters first, so that a reader of the state has them."""
        assert self._x is not None
        turn = {"episode": self._episode.episode, "tick": self._episode.tick}
        head = {"header": self._header(), "sender": self._others.sender, **turn}
        p = self.task.parameters_at({}, self._commanded())
        self._commanding.publish(msg.TaskParameters(**head, **parameter_fields(self.task, p)))
        fields = {**state_fields(self.task, self._x, self._u, self._episode.touchdowns), "running": running}
        self._states.publish(msg.RobotState(**head, **fields))
        told = {"name": self._episode.coordinates, "position": fields["q"], "velocity": fields["dq"]}
        self._joints.publish(JointState(header=head["header"], **told))

    def _header(self) -> Header:
        """Simulated time."""
        seconds, nanoseconds = divmod(round(self._clock_ticks * self.task.seconds * 1e9), 1_000_000_000)
        return Header(stamp=Time(sec=seconds, nanosec=nanoseconds), frame_id="world")

    def _status(self) -> Status:
        figures = {"episode": self._episode.episode, "outcome": self._episode.outcome}
        is_done = self._x is None and self._episode.episode >= self._own.episodes
        if self._others.refusal:
            return WARN, self._others.refusal, figures
        if self._x is None and not is_done and not self._is_heard():
            return WARN, "waiting for a controller, or more readers", figures
        if self._x is None and not is_done and not self._is_planned():
            return WARN, f"waiting for the trainer: no plan after episode {self._episode.episode}", figures
        return OK, "all episodes are done" if is_done else f"episode {self._episode.episode}", figures


def main() -> None:
    """The executable `simulator`."""
    run(SimulatorNode, errors=(TaskError,))
