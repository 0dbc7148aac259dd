"""Publishes what comes every tick: as bytes made at once, and only while somebody reads it."""

from typing import Any

from rclpy.node import Node

from rabbit_common.ros.cdr import Encoder
from rabbit_common.ros.qos import TICK


class TickPublisher:
    """A publisher with the QoS `TICK`, which nobody who comes later would hear."""

    def __init__(self, node: Node, kind: Any, topic: str) -> None:
        self._publisher, self._encoder = node.create_publisher(kind, topic, TICK), Encoder(kind)

    @property
    def readers(self) -> int:
        """Nodes that read the topic."""
        return int(self._publisher.get_subscription_count())

    def publish(self, message: Any) -> None:
        """Publish an object with the message's fields; raises `CdrError` for a value that does not fit."""
        if self._publisher.get_subscription_count():
            self._publisher.publish(self._encoder.encode(message))
