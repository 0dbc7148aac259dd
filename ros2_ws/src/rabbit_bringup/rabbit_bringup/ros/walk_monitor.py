"""The launcher's own node: sees who is ready, lets the walk begin, and says how it goes."""

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rabbit_cli.exit_codes import CUT_SHORT
from rabbit_description.force_ratio import force_ratio
from rabbit_description.state import TICK_SECONDS
from rabbit_msgs.msg import ControllerState, Episode, EpisodePlan, Landing, RabbitState
from rabbit_msgs.srv import Pause
from rabbit_ros.ros.diagnostics import reader_counts
from rabbit_ros.ros.network import initialise
from rabbit_ros.ros.qos import DIAGNOSTICS, EVENT
from rabbit_ros.ros.services import call_service
from rabbit_ros.ros.topics import TOPICS, Topic, missing_readers
from rclpy.experimental import EventsExecutor
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.serialization import deserialize_message

GLANCE = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)


@dataclass(frozen=True)
class Progress:
    """How the walk stands."""

    episode: int
    stone: int
    stones: int
    margin: float  # m, of the last landing
    slack: float
    ratio: float  # |F_T| / F_N of the stance foot
    ticks: int  # of all episodes so far


class WalkMonitor:
    """Hears the graph in a namespace; `tell` gets the message of each episode that has ended."""

    def __init__(self, namespace: str, tell: Callable[[Episode], object] = lambda _: None) -> None:
        self._context = rclpy.Context()
        initialise(self._context, ["--ros-args", "--enclave", "/rabbit/launcher"])
        self._node = rclpy.create_node("launcher", namespace=namespace, context=self._context)
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._tell = tell
        self._said: dict[str, DiagnosticStatus] = {}
        self._newest: dict[str, bytes] = {}
        self.episode = Episode()
        self.ended: dict[int, Episode] = {}
        self.complaint = ""  # of a simulator that cannot go on
        self.digested = 0  # episodes that the trainer has learned from
        self.seconds = 0.0  # of the ended episodes
        self._began = time.monotonic()
        self._margin = math.nan
        subscribe = self._node.create_subscription
        subscribe(DiagnosticArray, "diagnostics", self._on_diagnostics, DIAGNOSTICS)
        subscribe(Episode, "episode", self._on_episode, EVENT)
        subscribe(EpisodePlan, "episode_plan", self._on_plan, EVENT)
        subscribe(Landing, "landing", self._on_landing, EVENT)
        for name, kind in (("state", RabbitState), ("controller_state", ControllerState)):
            subscribe(kind, name, partial(self._newest.__setitem__, name), GLANCE, raw=True)
        self._pause = self._node.create_client(Pause, "pause")

    def close(self) -> None:
        """Leave the graph."""
        self._executor.remove_node(self._node)
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def spin(self, seconds: float) -> None:
        """Hear what comes for so long."""
        end = time.monotonic() + seconds
        while (left := end - time.monotonic()) > 0:
            self._executor.spin_once(left)

    def not_ready(self, nodes: list[str]) -> dict[str, str]:
        """Which of the nodes are not ready, and what they say; and topics that do not reach all who need them."""
        unheard = DiagnosticStatus(level=DiagnosticStatus.WARN, message="not heard of yet")
        said = {name: self._said.get(name, unheard) for name in nodes}
        told: dict[str, int] = {}
        for status in said.values():
            told |= reader_counts(status)
        alone = dict.fromkeys(missing_readers([*nodes, "launcher"], told, self._others(nodes)), "too few readers")
        return {name: s.message for name, s in said.items() if s.level != DiagnosticStatus.OK} or alone

    def _others(self, nodes: list[str]) -> dict[str, int]:
        """Readers of each topic that belong to nobody we started, as a viewer that was there before."""
        known = (*nodes, "launcher")
        found = {topic.name: self._node.get_subscriptions_info_by_topic(self._full_name(topic)) for topic in TOPICS}

        def is_ours(end: Any) -> bool:
            return bool(end.node_name.removeprefix("_").startswith(known))  # the viewer's hidden node is the viewer's

        return {name: sum(not is_ours(end) for end in ends) for name, ends in found.items()}

    def _full_name(self, topic: Topic) -> str:
        return self._node.resolve_topic_name(topic.name)

    def is_over(self, episodes: int) -> bool:
        """Whether so many episodes have ended, the last of them not cut short: another one takes its place."""
        e = self.episode
        return e.phase == Episode.ENDED and e.episode >= episodes and e.outcome != CUT_SHORT

    def begin(self, timeout: float = 10.0) -> bool:
        """Let the simulator go on; False if it does not answer."""
        answer = call_service(self._pause, Pause.Request(paused=False), self.spin, timeout)
        return bool(answer and answer.accepted)

    def progress(self) -> Progress:
        """How it goes, from the newest messages."""
        state: Any = self._decode("state", RabbitState)
        details: Any = self._decode("controller_state", ControllerState)
        ratio = float(force_ratio(np.asarray(state.foot_force).reshape(2, 2)[details.stance]))
        e = self.episode
        ticks = round((state.stamp.sec + state.stamp.nanosec * 1e-9) / TICK_SECONDS)
        return Progress(e.episode, state.touchdowns, e.stones, self._margin, details.clf_slack, ratio, ticks)

    def _decode(self, name: str, kind: Any) -> Any:
        data = self._newest.get(name)
        return deserialize_message(data, kind) if data else kind()

    def _on_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            self._said[status.name.split("/")[-1]] = status

    def _on_episode(self, message: Episode) -> None:
        if message.phase == Episode.RUNNING and message.tick == 0:
            self._began = time.monotonic()
        if message.phase == Episode.ENDED and message.episode in self.ended:
            self.complaint = message.reason
        elif message.phase == Episode.ENDED:
            self.seconds += time.monotonic() - self._began
            self.ended[message.episode] = message
            self._tell(message)
        self.episode = message

    def _on_plan(self, message: EpisodePlan) -> None:
        self.digested = message.after_episode

    def _on_landing(self, message: Landing) -> None:
        self._margin = min(message.l - message.l_min, message.l_max - message.l)
