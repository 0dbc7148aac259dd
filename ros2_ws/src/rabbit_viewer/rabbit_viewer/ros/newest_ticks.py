"""Takes the newest ticks of a graph when a picture is due; no message wakes the viewer.

A lock-step walk publishes a thousand messages a second, of which a view needs a few; a callback for each would take
the walkers' processors from them. So messages stay bytes: most ticks are never looked at.
"""

from typing import Any

from rabbit_common.message_checks import Refused, check_finite
from rabbit_common.ros.checked_subscription import decoded
from rabbit_msgs.msg import ControllerState, RabbitState
from rabbit_recording.message_header import turn_of
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

NEWEST = QoSProfile(depth=3, reliability=ReliabilityPolicy.BEST_EFFORT)
TICK_TOPICS = {"state": RabbitState, "controller_state": ControllerState}
KEPT = 16  # ticks that wait for their last part


class TickMessages:
    """The newest ticks of which there is a message on each of `topics`; all begin with stamp, episode, tick.

    `parts`: of tick `key` (episode, tick), the newest; `earlier`: of the ticks since the last `take`, the oldest first.
    """

    def __init__(self, *topics: str) -> None:
        self._topics = frozenset(topics)
        self.clear()

    def clear(self) -> None:
        """Forget all."""
        self._waiting: dict[tuple[int, int], dict[str, bytes]] = {}
        self.key: tuple[int, int] | None = None  # episode, tick
        self.parts: dict[str, bytes] = {}
        self.earlier: list[dict[str, bytes]] = []

    def add(self, topic: str, data: bytes) -> None:
        """Take a serialised message."""
        key = turn_of(data)
        parts = self._waiting.setdefault(key, {})
        parts[topic] = data
        if parts.keys() == self._topics:
            if self.parts:
                self.earlier.append(self.parts)
            self.key, self.parts = key, self._waiting.pop(key)
        elif len(self._waiting) > KEPT:
            del self._waiting[next(iter(self._waiting))]


class NewestTicks(TickMessages):
    """Subscriptions of a node that no executor spins, so that messages wait, the newest few of each topic.

    It is a node of its own, since an executor spins all of a node; hidden, as a name with a leading underscore says. It
    is named after `node`, and hears the topics under the names that `node` was given for them.
    """

    def __init__(self, node: Node) -> None:
        super().__init__(*TICK_TOPICS)
        self._node = Node(
            f"_{node.get_name()}_ticks",
            namespace=node.get_namespace(),
            use_global_arguments=False,
            start_parameter_services=False,
            enable_rosout=False,
        )
        self._heard = {
            name: self._node.create_subscription(kind, node.resolve_topic_name(name), lambda _: None, NEWEST, raw=True)
            for name, kind in TICK_TOPICS.items()
        }

    def take(self) -> None:
        """Take what waits."""
        self.earlier, shown = [], self.key
        for name, heard in self._heard.items():
            with heard.handle:
                while taken := heard.handle.take_message(heard.msg_type, True):
                    self.add(name, taken[0])
        if shown is not None and self.earlier:
            self.earlier.pop(0)  # the newest of the last time

    def close(self) -> None:
        """Hear no more."""
        self._node.destroy_node()


def checked_tick(parts: dict[str, bytes]) -> tuple[Any, Any]:
    """State and controller state of a tick; raises `Refused`."""
    state, details = (decoded(parts[name], kind, {}) for name, kind in TICK_TOPICS.items())
    check_finite("q", state.q)
    check_finite("foot_force", state.foot_force)
    if details.stance not in (0, 1):
        raise Refused("no leg", f"stance = {details.stance}; expected 0 or 1")
    return state, details
