"""What the simulator publishes and logs: the messages of a tick, and where the episode stands."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from geometry_msgs.msg import WrenchStamped
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
from rabbit_description.state import FEET, LAYOUT, Leg, RobotState, StonePreview
from rabbit_msgs.msg import Episode
from rabbit_msgs.msg import Landing as LandingMessage
from rabbit_msgs.msg import RobotState as StateMessage
from rabbit_msgs.msg import StonePreview as PreviewMessage
from rclpy.node import Node
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import Imu, JointState
from std_msgs.msg import Header

from rabbit_sim.parameters import NodeParameters, SimulationParameters
from rabbit_sim.plant import PlantReading
from rabbit_sim.restart_file import RestartPoint
from rabbit_sim.simulation import Landing


class SimulatorPublishers:
    """The simulator's publishers.

    With a lab's sensors the state is another node's estimate; the truth is published too, for judges alone.
    A robot's own drivers say what its sensors say.
    """

    def __init__(self, node: Node, p: SimulationParameters, own: NodeParameters, sender: str) -> None:
        self._log, self._is_lab, self._sender = node.get_logger(), p.sensors == "lab", sender
        if self._is_lab:
            self._imu = node.create_publisher(Imu, "imu", TICK)
            self._truth = node.create_publisher(StateMessage, "true_state", TICK)
            gyro, accelerometer = p.gyro_noise**2 + p.gyro_bias**2, p.accelerometer_noise**2 + p.accelerometer_bias**2
            self._variances = p.attitude_error**2, gyro, accelerometer
        self._states = node.create_publisher(StateMessage, "measured" if self._is_lab else "state", TICK)
        has_drivers = not own.IS_SIMULATED
        self._message = StateMessage(sender=sender)
        self._joints = None if has_drivers else node.create_publisher(JointState, "joint_states", TICK)
        feet = () if has_drivers else FEET
        self._wrenches = [node.create_publisher(WrenchStamped, f"{foot}_foot/wrench", TICK) for foot in feet]
        self._frames = RobotFrames(node) if own.publish_tf and not self._is_lab else None
        self._clock = node.create_publisher(Clock, "clock", TICK)
        self._previews = node.create_publisher(PreviewMessage, "preview", EVENT)
        self._landings = node.create_publisher(LandingMessage, "landing", EVENT)
        self.episodes = node.create_publisher(Episode, "episode", EVENT)
        self._preview: StonePreview | None = None
        self._landings_sent = 0

    @property
    def readers(self) -> int:
        """Nodes that hear the state, or what is measured of it."""
        return int(self._states.get_subscription_count())

    def begin(self, e: Episode) -> None:
        """Another episode begins; logs it as in `episode 2 begins: seed 8, 20 stones, policy 1f2e3d4c5b6a`."""
        self._preview, self._landings_sent = None, 0
        policy = f", policy {e.policy_version}" if e.policy_version else ""
        self._log.info(f"episode {e.episode} begins: seed {e.seed}, {e.stones} stones{policy}")

    def end(self, e: Episode) -> None:
        """Logs it as in `episode 2 ends, fall: 7 of 20 stones, 341 ticks`; an episode with a reason is a warning."""
        walked = e.touchdowns - (e.outcome == "miss")
        line = f"episode {e.episode} ends, {e.outcome}: {walked} of {e.stones} stones, {e.tick} ticks"
        if e.reason:
            self._log.warning(f"{line}: {e.reason}")
        else:
            self._log.info(line)

    def tick(
        self, state: RobotState, episode: int, at: Header, landings: Sequence[Landing], reading: PlantReading
    ) -> None:
        """A tick; what the controller needs with the state goes before it. `landings`: all of the episode."""
        if state.preview is not None and state.preview != self._preview:
            self._previews.publish(preview_message(state.preview, episode, at, self._sender))
        self._preview = state.preview
        self._state(state, episode, at)
        if self._clock.get_subscription_count():  # what follows the controller does not wait for
            self._clock.publish(Clock(clock=at.stamp))
        if self._is_lab and self._truth.get_subscription_count():
            true = replace(state, q=reading.q, dq=reading.dq, foot_force=reading.foot_force)
            self._truth.publish(state_message(true, episode, at))
        elif not self._is_lab and self._joints and self._joints.get_subscription_count():
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

    def again(self, state: RobotState, episode: int, at: Header) -> None:
        """What the answer to a tick needs: its reader may just have come, or have heard something else."""
        if state.preview is not None:
            self._previews.publish(preview_message(state.preview, episode, at, self._sender))
        self._state(state, episode, at)

    def _state(self, state: RobotState, episode: int, at: Header) -> None:
        """What is answered: with a lab's sensors in three parts."""
        write_state(self._message, state, episode, at)
        self._states.publish(self._message)
        if self._joints and state.sensors:
            self._joints.publish(encoder_message(state.sensors, at, state.applied))
            self._imu.publish(imu_message(state.sensors, at, self._variances))


KEPT = ("episode", "tick", "touchdowns", "seed", "sigma", "policy_version")  # of an episode, in the restart file


def of_our_robot(**fields: Any) -> Episode:
    """An announcement, with the names of what our arrays hold."""
    return Episode(**{name: list(names) for name, names in LAYOUT.items()}, **fields)


def episode_of(before: RestartPoint, sender: str, **told: Any) -> Episode:
    """The newest episode of the simulator before this one; where that was killed in its middle, it is over."""
    episode = of_our_robot(sender=sender, **told, **{name: getattr(before, name) for name in KEPT})
    if not before.episode:
        episode.sigma = math.nan
    if before.running:
        episode.outcome, episode.reason = "reset", "the simulator was started again"
        episode.phase = Episode.ENDED
    return episode
