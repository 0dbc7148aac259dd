"""Takes the newest ticks of a graph when a picture is due; nothing wakes the viewer when one is told.

A lock-step walk tells a thousand messages a second, of which a view needs a few; to be called for each would take the
walkers' processors from them.
"""

from collections.abc import Iterator
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

NEWEST = QoSProfile(depth=3, reliability=ReliabilityPolicy.BEST_EFFORT)


class NewestTicks:
    """Subscriptions of a node that no executor spins, so that messages wait, the newest few of each topic."""

    def __init__(self, topics: dict[str, Any]) -> None:
        self._node = Node("viewer_ticks", start_parameter_services=False, enable_rosout=False)
        self._heard = [
            self._node.create_subscription(kind, name, lambda _: None, NEWEST, raw=True)
            for name, kind in topics.items()
        ]

    def take(self) -> Iterator[tuple[str, bytes]]:
        """What waits: the topic's name as it was given, and the serialised message."""
        for heard in self._heard:
            with heard.handle:
                while taken := heard.handle.take_message(heard.msg_type, True):
                    yield heard.topic, taken[0]

    def close(self) -> None:
        """Hear no more."""
        self._node.destroy_node()
