"""Who may answer a state. A killed controller stays in the graph for 20 s, so being there is not enough."""

import time

from rclpy.node import Node
from rclpy.subscription import Subscription

DEAD_SECONDS = 25.0  # after which the graph has forgotten a dead one: who is still there lives


class LiveControllers:
    """The publishers of torques, but for those that were asked and said nothing: until one speaks, or for 25 s.

    One that comes while a tick waits for another's answer has not been asked from the start: it keeps its chance.
    """

    def __init__(self, node: Node, torques: Subscription) -> None:
        self._node, self._torques = node, torques
        self._asked: frozenset[bytes] | None = None
        self._deaf: frozenset[bytes] = frozenset()
        self._since = 0.0  # when they were found deaf

    @property
    def any(self) -> bool:
        """Whether somebody is there to be asked; who was away and came back is."""
        present = self._present()
        self._deaf &= present if time.monotonic() - self._since < DEAD_SECONDS else frozenset()
        return self._torques.get_publisher_count() > 0 and present > self._deaf

    def spoke(self) -> None:
        """An answer came, be it of use or not."""
        self._asked, self._deaf = None, frozenset()

    def asked_again(self) -> None:
        """A tick's answer is late: who is there now is waited for."""
        if self._asked is None:
            self._asked = self._present()

    def said_nothing(self) -> None:
        """The wait is over."""
        self._deaf = self._present() if self._asked is None else self._asked
        self._asked, self._since = None, time.monotonic()

    def _present(self) -> frozenset[bytes]:
        found = self._node.get_publishers_info_by_topic(self._torques.topic_name)
        return frozenset(bytes(each.endpoint_gid) for each in found)
