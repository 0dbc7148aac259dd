"""Nodes in one process: what one of them publishes goes to the other by a call; other processes read it as ever.

Messages are handed over in the order in which they were published, one after the other, and never in the middle of a
callback. Now and then the executor gets its turn: timers, services, and what comes from other processes.
"""

import copy
import time
from collections import deque
from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile

TURN_SECONDS = 0.005  # between two turns of the executor


class Direct:
    """The topics that are handed over: each has one reader in this process, and none elsewhere has their messages."""

    def __init__(self, *topics: str) -> None:
        self.topics = frozenset(topics)
        self._readers: dict[str, Callable[[Any], None]] = {}
        self._waiting: deque[tuple[Callable[[Any], None], Any]] = deque()
        self._node: Node | None = None
        self._is_going = False

    def subscribe(self, node: Node, topic: str, callback: Callable[[Any], None]) -> "DirectSubscription":
        """What is published on `topic` goes to `callback`, in the executor of `node`."""
        self._node, self._readers[topic] = node, callback
        return DirectSubscription(node, topic)

    def readers(self, topic: str) -> int:
        """Of the topic, in this process."""
        return int(topic in self._readers)

    def hand_over(self, topic: str, message: Any) -> None:
        """To the reader in this process, soon."""
        if topic in self._readers:
            self._waiting.append((self._readers[topic], message))
        if self._waiting and not self._is_going:
            self._schedule()

    def _schedule(self) -> None:
        executor = self._node.executor if self._node else None
        self._is_going = executor is not None
        if executor is not None:
            executor.create_task(self._go_on)

    def _go_on(self) -> None:
        end = time.monotonic() + TURN_SECONDS
        while self._waiting and time.monotonic() < end:
            callback, message = self._waiting.popleft()
            callback(message)
        self._is_going = False
        if self._waiting:
            self._schedule()


class DirectSubscription:
    """What a node asks a subscription for."""

    def __init__(self, node: Node, topic: str) -> None:
        self._node, self.topic_name = node, node.resolve_topic_name(topic)

    def get_publisher_count(self) -> int:
        """Publishers of the topic, in this process or elsewhere."""
        return int(self._node.count_publishers(self.topic_name))


class DirectPublisher:
    """Hands messages over, and publishes them for other processes."""

    def __init__(self, direct: Direct, topic: str, publisher: Publisher) -> None:
        self._direct, self._topic, self._publisher = direct, topic, publisher

    def publish(self, message: Any) -> None:
        """Hand over as it is now, and publish."""
        self._direct.hand_over(self._topic, copy.copy(message))
        self._publisher.publish(message)


def direct_of(node: Node, topic: str) -> Direct | None:
    """What hands the node's topic over; None where only the middleware does."""
    direct: Direct | None = getattr(node, "direct", None)
    return direct if direct is not None and topic in direct.topics else None


def create_publisher(node: Node, kind: Any, topic: str, qos: QoSProfile) -> Publisher | DirectPublisher:
    """A publisher that also reaches a reader in this process."""
    publisher = node.create_publisher(kind, topic, qos)
    direct = direct_of(node, topic)
    return DirectPublisher(direct, topic, publisher) if direct else publisher
