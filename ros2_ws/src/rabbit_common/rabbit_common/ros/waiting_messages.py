"""Messages that wait until somebody looks, of topics of which a few are enough.

A lock-step walk publishes a thousand messages a second, of which a view or a progress bar needs a few; a callback for
each would take the walkers' processors from them. So no message wakes anybody, and most are never looked at.
"""

from collections.abc import Iterator, Mapping
from typing import Any

from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

NEWEST = QoSProfile(depth=3, reliability=ReliabilityPolicy.BEST_EFFORT)


class WaitingMessages:
    """Subscriptions of a node that no executor spins, so that the newest few of each topic wait.

    It is a node of its own, since an executor spins all of a node; hidden, as a name with a leading underscore says. It
    is named after `node`, and hears the topics under the names that `node` was given for them.
    """

    def __init__(self, node: Node, kinds: Mapping[str, Any]) -> None:
        """`kinds`: of messages, by topic."""
        self._node = Node(
            f"_{node.get_name()}_ticks",
            context=node.context,
            namespace=node.get_namespace(),
            use_global_arguments=False,
            start_parameter_services=False,
            enable_rosout=False,
        )
        self._heard = {
            name: self._node.create_subscription(kind, node.resolve_topic_name(name), lambda _: None, NEWEST, raw=True)
            for name, kind in kinds.items()
        }

    def take(self) -> Iterator[tuple[str, bytes]]:
        """Topic and bytes of what waits, each topic's in its order."""
        for name, heard in self._heard.items():
            with heard.handle:
                while taken := heard.handle.take_message(heard.msg_type, True):
                    yield name, taken[0]

    def close(self) -> None:
        """Hear no more."""
        self._node.destroy_node()
