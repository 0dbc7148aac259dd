"""Hears the graph while faults come: what was told when, and what was acknowledged. Spins in a thread of its own."""

import random
import threading
import time
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import Any

import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from rabbit_msgs.msg import Episode
from rabbit_msgs.msg import Transition as TransitionMessage
from rabbit_recording.message_header import turn_of
from rabbit_ros.ros.topics import TOPICS
from rclpy.experimental import EventsExecutor
from rclpy.serialization import deserialize_message
from rclpy.signals import SignalHandlerOptions
from rl_trainer.ros.messages import transition_of
from rl_trainer.transitions import Transition

from rabbit_campaigns.ros.wrong_messages import HEARD, wrong_message

KEPT_TICKS = 50_000
LOOK_SECONDS = 0.05
KNOWN_SECONDS = 0.5  # until a new publisher is known to its readers

Turn = tuple[int, int]  # episode and tick


class GraphMonitor:
    """What was heard: `ticks` with their wall times, `acknowledged` transitions, the newest word of each node."""

    def __init__(self, namespace: str) -> None:
        self._context = rclpy.Context()
        rclpy.init(args=[], context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node("witness", namespace=namespace, context=self._context)
        self._executor = EventsExecutor(context=self._context)
        self.ticks: deque[tuple[float, Turn]] = deque(maxlen=KEPT_TICKS)
        self.count = 0  # of ticks that followed the one before
        self.acknowledged: list[Transition] = []
        self._turns: dict[str, dict[Turn, float]] = {"state": {}, "torque": {}, "controller_state": {}}  # first heard
        self.ended: dict[int, Episode] = {}
        self._ended_at: dict[int, float] = {}
        self.said: dict[str, DiagnosticStatus] = {}
        self.warnings: deque[tuple[float, str]] = deque(maxlen=1000)
        self._newest: dict[str, bytes] = {}
        self._kinds = {topic.name: topic.type for topic in TOPICS}
        self._publishers: dict[str, Any] = {}
        for topic in TOPICS:
            hears = {"state": self._on_state, "transition": self._on_transition, "episode": self._on_episode}
            hears |= {"diagnostics": self._on_diagnostics}
            hear = partial(self._on_bytes, topic.name, hears.get(topic.name))
            self._node.create_subscription(topic.type, topic.name, hear, topic.qos, raw=True)
        self._executor.add_node(self._node)
        self._ends = threading.Event()
        self._thread = threading.Thread(target=self._spin, name="witness", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Leave the graph."""
        self._ends.set()
        self._thread.join(timeout=5.0)
        self._executor.remove_node(self._node)
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    @property
    def newest(self) -> Turn:
        """The newest tick."""
        return self.ticks[-1][1] if self.ticks else (0, -1)

    def heard_before(self, moment: float, since: float = 0.0) -> list[Turn]:
        """The ticks heard from `since` on, before a moment of `time.monotonic`."""
        return [turn for at, turn in list(self.ticks) if since <= at < moment]

    @property
    def seen(self) -> frozenset[Turn]:
        """All ticks of which the state was heard."""
        return frozenset(self._turns["state"].copy())

    def answered(self, since: float, before: float) -> frozenset[Turn]:
        """The ticks of which state, torque and controller state were heard, all from `since` on, before a moment."""
        times = [dict(heard) for heard in self._turns.values()]
        whole = set.intersection(*(set(heard) for heard in times))
        return frozenset(turn for turn in whole if all(since <= heard[turn] < before for heard in times))

    def ended_within(self, since: float, before: float) -> dict[int, str]:
        """Episodes whose end was heard then, with their outcomes."""
        return {n: self.ended[n].outcome for n, at in list(self._ended_at.items()) if since <= at < before}

    def warned(self, since: float) -> list[str]:
        """What nodes warned of since a moment."""
        return [text for at, text in list(self.warnings) if at >= since]

    def refused(self) -> int:
        """Messages that the nodes say they have refused."""
        values = [value for status in list(self.said.values()) for value in status.values]
        return sum(int(value.value) for value in values if value.key.startswith("refused"))

    def disturb(self, rng: random.Random, node: str, seconds: float) -> int:
        """Send a node wrong messages for so long; returns how many."""
        self._publishers = {
            t.name: self._node.create_publisher(t.type, t.name, t.qos) for t in TOPICS if t.name in HEARD[node]
        }
        time.sleep(KNOWN_SECONDS)
        end, sent = time.monotonic() + seconds, 0
        while time.monotonic() < end:
            made = wrong_message(rng, node, self._newest, self._kinds)
            if made is not None:
                topic, data = made
                self._publishers[topic].publish(data)
                sent += 1
            time.sleep(LOOK_SECONDS)
        return sent

    def silence(self) -> None:
        """Take back the publishers of wrong messages: what is latched in them would come again."""
        while self._publishers:
            self._node.destroy_publisher(self._publishers.popitem()[1])

    def _spin(self) -> None:
        while not self._ends.is_set():
            self._executor.spin_once(LOOK_SECONDS)

    def _on_bytes(self, name: str, hear: Callable[[bytes], None] | None, data: bytes) -> None:
        if not self._publishers:  # else it may be our own
            self._newest[name] = data
        if name in self._turns:
            self._turns[name].setdefault(turn_of(data), time.monotonic())
        if hear is not None:
            hear(data)

    def _on_state(self, data: bytes) -> None:
        turn = turn_of(data)
        episode, tick = self.newest
        if turn == (episode, tick + 1) or (turn[1] == 0 and episode < turn[0] <= episode + 3):
            self.ticks.append((time.monotonic(), turn))
            self.count += 1

    def _on_transition(self, data: bytes) -> None:
        self.acknowledged.append(transition_of(deserialize_message(data, TransitionMessage)))

    def _on_episode(self, data: bytes) -> None:
        if self._publishers:
            return
        message: Any = deserialize_message(data, Episode)
        if message.phase == Episode.ENDED:
            self.ended.setdefault(message.episode, message)
            self._ended_at.setdefault(message.episode, time.monotonic())

    def _on_diagnostics(self, data: bytes) -> None:
        message: Any = deserialize_message(data, DiagnosticArray)
        for status in message.status:
            name = status.name.split("/")[-1]
            self.said[name] = status
            if status.level != DiagnosticStatus.OK:
                self.warnings.append((time.monotonic(), f"{name}: {status.message}"))
