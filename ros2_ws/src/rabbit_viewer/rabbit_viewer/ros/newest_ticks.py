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
    """Subscriptions of a node that no executor spins, so that messages wait, the newest few of each topic.

    It is a node of its own, since an executor spins all of a node; hidden, as a name with a leading underscore says. It
    is named after `node`, and hears the topics under the names that `node` was given for them.
    """

    def __init__(self, node: Node, topics: dict[str, Any]) -> None:
        self._node = Node(
            f"_{node.get_name()}_ticks",
            namespace=node.get_namespace(),
            use_global_arguments=False,
            start_parameter_services=False,
            enable_rosout=False,
        )
        self._heard = {
            name: self._node.create_subscription(kind, node.resolve_topic_name(name), lambda _: None, NEWEST, raw=True)
            for name, kind in topics.items()
        }

    def take(self) -> Iterator[tuple[str, bytes]]:
        """What waits: the topic's name as it was given, and the serialised message."""
        for name, heard in self._heard.items():
            with heard.handle:
                while taken := heard.handle.take_message(heard.msg_type, True):
                    yield name, taken[0]

    def close(self) -> None:
        """Hear no more."""
        self._node.destroy_node()
