"""Of several simulators in one graph the first one that is heard is followed, as long as it answers for itself.

A sender is what a simulator writes into its messages; the empty one is a sender too. Simulators hear and answer the
announcements of others (`rabbit_sim.ros.other_simulators`). So another one takes over only where the first one does not
answer its announcement: it is dead, or has ended.
"""

import time
from collections import deque
from collections.abc import Callable
from typing import Any

from rabbit_msgs.msg import Episode
from rclpy.qos import QoSProfile
from rclpy.subscription import Subscription

from rabbit_common.message_checks import Refused
from rabbit_common.ros.checked_node import CheckedNode
from rabbit_common.ros.spin import steady_timer

PATIENCE = 2.0  # s that the simulator which is followed has for its answer
LOOK_SECONDS = 0.25
KEPT = 20  # announcements of another one, which count once it is followed


class SimulatorFollower(CheckedNode):
    """A node that hears simulators. `simulator`: the sender that is followed, None before the first."""

    _take_episode: Callable[[Any], None]

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self.simulator: str | None = None
        self._other, self._others_since = deque[Episode](maxlen=KEPT), 0.0
        steady_timer(self, LOOK_SECONDS, self._follow_other)

    def _hear_simulator(self, kind: Any, topic: str, callback: Callable[[Any], None], qos: QoSProfile) -> Subscription:
        """Hears, as `_hear` does, a topic of simulators."""

        def take(message: Any) -> None:
            self._check_simulator(message)
            callback(message)

        if kind is Episode:
            self._take_episode = callback
        return self._hear(kind, topic, take, qos)

    def _check_simulator(self, message: Any) -> None:
        if self.simulator is None:
            self.simulator = message.sender
        if message.sender == self.simulator:
            self._other.clear()
            return
        if isinstance(message, Episode):
            if not self._other or self._other[0].sender != message.sender:
                self._other.clear()
                self._others_since = time.monotonic()
            self._other.append(message)
        raise Refused("another simulator", f"{named(message.sender)}; {named(self.simulator)} is followed")

    def _follow_other(self) -> None:
        """Where the one that is followed does not answer."""
        if not self._other or time.monotonic() - self._others_since < PATIENCE:
            return
        words, before = list(self._other), self.simulator
        self._other.clear()
        self.simulator = words[0].sender
        self.get_logger().warning(f"follows {named(self.simulator)}: {named(before)} does not answer")
        for word in words:
            self._guarded("episode", self._take_episode)(word)


def named(sender: str | None) -> str:
    """A sender in a sentence."""
    return sender or "a simulator without a name"
