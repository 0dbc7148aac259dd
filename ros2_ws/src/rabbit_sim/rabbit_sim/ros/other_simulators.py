"""One simulator plays in a graph, the one that began first: it answers others' announcements, and they give way.

A simulator that has given way plays on once no other one is in the graph.
"""

import time
from collections.abc import Callable

from rabbit_common.ros.checked_node import CheckedNode
from rabbit_common.ros.qos import EVENT
from rabbit_common.ros.simulator_follower import named
from rabbit_msgs.msg import Episode

DISCOVERY_SECONDS = 1.0  # in which others are heard, before an episode begins


class OtherSimulators:
    """`sender`: this one's, its name and when it began; `first`: the one to which it gives way; empty: to none."""

    def __init__(self, node: CheckedNode, claim: Callable[[], object], give_way: Callable[[str], object]) -> None:
        """`claim` answers another's announcement with this one's; `give_way` ends what is played, for a reason."""
        self._node, self._claim, self._give_way = node, claim, give_way
        self.sender = f"{node.get_fully_qualified_name()} {time.time_ns():016x}"[-128:]
        self.first, self._born = "", time.monotonic()
        self._refused = {self.sender}  # which have been named
        self._announcements = node._hear(Episode, "episode", self._on_episode, EVENT)

    @property
    def may_play(self) -> bool:
        """Whether an episode may begin."""
        return not self.first and time.monotonic() - self._born > DISCOVERY_SECONDS

    @property
    def refusal(self) -> str:
        """Why it does not play; empty: it does."""
        return f"another simulator plays: {self.first} began first; this is {self.sender}" if self.first else ""

    def look(self) -> None:
        """Play on where the other one has left the graph."""
        if self.first and self._announcements.get_publisher_count() <= 1:
            self._node.get_logger().info(f"plays on: {self.first} has left")
            self.first = ""
            self._claim()

    def _on_episode(self, message: Episode) -> None:
        sender = message.sender
        if sender == self.sender or self.first:
            return
        if sender and began(sender) < began(self.sender):
            self.first = sender
            self._node.get_logger().error(self.refusal)
            self._give_way(self.refusal)
            return
        if sender not in self._refused:
            self._refused.add(sender)
            self._node.get_logger().error(f"two simulators: {named(sender)} is refused; {self.sender} is followed")
        self._claim()


def began(sender: str) -> str:
    """What orders senders by when they began."""
    return sender.rpartition(" ")[2]
