"""What the simulator publishes and logs: the messages of a tick, and where the episode stands."""

import math
from dataclasses import replace
from typing import Any

from geometry_msgs.msg import WrenchStamped
from rabbit_common.message_checks import doubles
from rabbit_common.ros.conversions import (
    encoder_message,
    foot_wrench,
    imu_message,
    joint_state,
    preview_message,
    state_message,
    write_state,
)
from rabbit_common.ros.qos import EVENT, TICK
from rabbit_common.ros.robot_frames import RobotFrames
from rabbit_common.task_messages import parameter_fields
from rabbit_description.force_ratio import force_ratio
from rabbit_description.state import FEET, Leg, RobotState, StonePreview
from rabbit_description.task import ControlTask
from rabbit_description.task_state import p_of
from rabbit_msgs.msg import Episode, TaskParameters
from rabbit_msgs.msg import Landing as LandingMessage
from rabbit_msgs.msg import RobotState as StateMessage
from rabbit_msgs.msg import StonePreview as PreviewMessage
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Header

from rabbit_sim.parameters import PlayerParameters
from rabbit_sim.restart_file import RestartPoint
from rabbit_sim.simulation import Simulation


class Publishers:
    """What every simulator publishes: announcements, the clock, and the state of a tick, see `tick`."""

    is_lab = False
    stones = 0  # of an episode

    def __init__(self, node: Node, sender: str, state: str = "state") -> None:
        self._log, self.sender = node.get_logger(), sender
        self._message = StateMessage(sender=sender)
        self._states = node.create_publisher(StateMessage, state, TICK)
        self._clock = node.create_publisher(Clock, "clock", TICK)
        self.episodes = node.create_publisher(Episode, "episode", EVENT)

    @property
    def readers(self) -> int:
        """Nodes that hear all that a controller answers."""
        return int(self._states.get_subscription_count())

    @property
    def figures(self) -> dict[str, float]:
        """The figures for diagnostics."""
        return {}

    def begin(self, e: Episode) -> None:
        """Another episode begins; logs it as in `episode 2 begins: seed 8, 20 stones, policy 1f2e3d4c5b6a`."""
        stones = f", {e.stones} stones" if e.stones else ""
        policy = f", policy {e.policy_version}" if e.policy_version else ""
        self._log.info(f"episode {e.episode} begins: seed {e.seed}{stones}{policy}")

    def end(self, e: Episode) -> None:
        """Logs it as in `episode 2 ends, fall: 7 of 20 stones, 341 ticks`; an episode with a reason is a warning."""
        walked = e.touchdowns - (e.outcome == "miss")
        stones = f"{walked} of {e.stones} stones, " if e.stones else ""
        line = f"episode {e.episode} ends, {e.outcome}: {stones}{e.tick} ticks"
        if e.reason:
            self._log.warning(f"{line}: {e.reason}")
        else:
            self._log.info(line)

    def tick(self, state: RobotState, episode: int, at: Header) -> None:
        """A tick; what the controller needs with the state goes before it."""
        self._state(state, episode, at)
        if self._clock.get_subscription_count():  # what follows the controller does not wait for
            self._clock.publish(Clock(clock=at.stamp))

    def again(self, state: RobotState, episode: int, at: Header) -> None:
        """What the answer to a tick needs: its reader may just have come, or have heard something else."""
        self._state(state, episode, at)

    def _state(self, state: RobotState, episode: int, at: Header) -> None:
        """What is answered."""
        write_state(self._message, state, episode, at)
        self._states.publish(self._message)


class TaskPublishers(Publishers):
    """The publishers of a control task: with each state what it is commanded, and its joints."""

    def __init__(self, node: Node, task: ControlTask, sender: str) -> None:
        super().__init__(node, sender)
        self._task = task
        self._parameters = node.create_publisher(TaskParameters, "parameters", TICK)
        self._joints = node.create_publisher(JointState, "joint_states", TICK)

    @property
    def is_heard(self) -> bool:
        """Whether anybody hears the joints."""
        return self._joints.get_subscription_count() > 0

    def _state(self, state: RobotState, episode: int, at: Header) -> None:
        head = {"header": at, "episode": episode, "tick": state.tick, "sender": self.sender}
        self._parameters.publish(TaskParameters(**head, **parameter_fields(self._task, p_of(state))))
        super()._state(state, episode, at)
        if self.is_heard:
            told = {"position": doubles(state.q), "velocity": doubles(state.dq)}
            self._joints.publish(JointState(header=at, name=list(self._task.names_of_q), **told))


class RabbitPublishers(Publishers):
    """RABBIT's.

    With a lab's sensors the state is another node's estimate; the truth is published too, for judges alone.
    What a robot's sensors say, the robot's drivers publish.
    """

    def __init__(self, node: Node, simulation: Simulation, parameters: PlayerParameters, sender: str) -> None:
        p = simulation.parameters
        super().__init__(node, sender, "measured" if p.sensors == "lab" else "state")
        self._simulation, self.is_lab, self.stones = simulation, p.sensors == "lab", p.stones
        if self.is_lab:
            self._imu = node.create_publisher(Imu, "imu", TICK)
            self._truth = node.create_publisher(StateMessage, "true_state", TICK)
            gyro, accelerometer = p.gyro_noise**2 + p.gyro_bias**2, p.accelerometer_noise**2 + p.accelerometer_bias**2
            self._variances = p.attitude_error**2, gyro, accelerometer
        has_drivers = not parameters.IS_SIMULATED
        self._joints = None if has_drivers else node.create_publisher(JointState, "joint_states", TICK)
        feet = () if has_drivers else FEET
        self._wrenches = [node.create_publisher(WrenchStamped, f"{foot}_foot/wrench", TICK) for foot in feet]
        self._frames = RobotFrames(node) if parameters.publish_tf and not self.is_lab else None
        self._previews = node.create_publisher(PreviewMessage, "preview", EVENT)
        self._landings = node.create_publisher(LandingMessage, "landing", EVENT)
        self._preview: StonePreview | None = None
        self._landings_sent = 0
        self._newest: RobotState | None = None  # state of the episode that runs

    @property
    def figures(self) -> dict[str, float]:
        """|F_T| / F_N of the stance foot as measured; NaN where it is not loaded."""
        if self._newest is None:
            return {"force ratio": math.nan}
        return {"force ratio": float(force_ratio(self._newest.foot_force[Leg.standing(self._newest.touchdowns)]))}

    def begin(self, e: Episode) -> None:
        self._preview, self._landings_sent = None, 0
        super().begin(e)

    def end(self, e: Episode) -> None:
        self._newest = None
        super().end(e)

    def tick(self, state: RobotState, episode: int, at: Header) -> None:
        reading, landings = self._simulation.reading, self._simulation.landings
        if state.preview is not None and state.preview != self._preview:
            self._previews.publish(preview_message(state.preview, episode, at, self.sender))
        self._preview = state.preview
        super().tick(state, episode, at)
        if self.is_lab and self._truth.get_subscription_count():
            true = replace(state, q=reading.q, dq=reading.dq, foot_force=reading.foot_force)
            self._truth.publish(state_message(true, episode, at))
        elif not self.is_lab and self._joints and self._joints.get_subscription_count():
            self._joints.publish(joint_state(state, at))
        if self._frames and self._frames.are_read:
            self._frames.publish(self._message)
        for foot, publisher in enumerate(self._wrenches):
            if publisher.get_subscription_count():
                hip, knee = reading.q[Leg(foot).joints]
                angle = float(reading.q[2] + hip + knee)
                publisher.publish(foot_wrench(state.foot_force[foot], angle, foot, at))
        for landing in landings[self._landings_sent :]:
            fields = {name: getattr(landing, name) for name in ("tick", "index", "l", "l_min", "l_max", "on_stone")}
            self._landings.publish(LandingMessage(header=at, episode=episode, **fields))
        self._landings_sent = len(landings)
        self._newest = state

    def again(self, state: RobotState, episode: int, at: Header) -> None:
        if state.preview is not None:
            self._previews.publish(preview_message(state.preview, episode, at, self.sender))
        super().again(state, episode, at)

    def _state(self, state: RobotState, episode: int, at: Header) -> None:
        """Publishes a state; with a lab's sensors in three parts."""
        super()._state(state, episode, at)
        if self._joints and state.sensors:
            self._joints.publish(encoder_message(state.sensors, at, state.applied))
            self._imu.publish(imu_message(state.sensors, at, self._variances))


KEPT = ("episode", "tick", "touchdowns", "seed", "sigma", "policy_version")  # of an episode, in the restart file


def episode_of(before: RestartPoint, **told: Any) -> Episode:
    """The newest episode of the simulator before this one; where that was killed in its middle, it is over."""
    episode = Episode(**told, **{name: getattr(before, name) for name in KEPT})
    if not before.episode:
        episode.sigma = math.nan
    if before.running:
        episode.outcome, episode.reason = "reset", "the simulator was started again"
        episode.phase = Episode.ENDED
    return episode
