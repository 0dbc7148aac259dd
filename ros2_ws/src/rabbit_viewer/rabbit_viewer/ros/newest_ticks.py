"""The newest ticks of a graph, put together of messages that stay bytes until a picture is due.

A lock-step walk publishes a thousand messages a second, of which a view needs a few; a callback for each would take the
walkers' processors from them. So no message wakes anybody, and most are never looked at.
"""

from collections.abc import Set as AbstractSet

from rabbit_common.message_checks import Refused, check_finite, check_lengths
from rabbit_common.ros.checked_node import decoded
from rabbit_common.ros.conversions import LENGTHS
from rabbit_msgs.msg import ControllerState, LearnerTerms, RobotState
from rabbit_recording.message_header import turn_of
from rclpy.node import Node
from rclpy.qos import QoSProfile, ReliabilityPolicy

TICK_TOPICS = {"state": RobotState, "controller_state": ControllerState, "learner_terms": LearnerTerms}
NEWEST = QoSProfile(depth=3, reliability=ReliabilityPolicy.BEST_EFFORT)
KEPT = 16  # ticks that wait for their last part


class NewestTicks:
    """The newest ticks of which there are messages on all of some topics; they begin with header, episode, tick.

    `parts`: of the newest tick, by topic. The subscriptions belong to another node, which no executor spins, so that
    messages wait. It is hidden, as a name with a leading underscore says, is named after `node`, and hears the topics
    under the names that `node` was given for them.
    """

    def __init__(self, node: Node) -> None:
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
            for name, kind in TICK_TOPICS.items()
        }
        self.clear()

    def close(self) -> None:
        """Hear no more."""
        self._node.destroy_node()

    def clear(self) -> None:
        """Forget all."""
        self._waiting: dict[tuple[int, int], dict[str, bytes]] = {}
        self._key: tuple[int, int] | None = None  # of the newest: episode, tick
        self.parts: dict[str, bytes] = {}

    def take(self, topics: AbstractSet[str]) -> list[dict[str, bytes]]:
        """The ticks that are whole with what waits, as bytes by topic, the oldest first.

        `topics` may change: a controller of another kind publishes fewer.
        """
        whole = []
        for topic, heard in self._heard.items():
            with heard.handle:
                while taken := heard.handle.take_message(heard.msg_type, True):
                    whole += self._add(topic, taken[0], topics)
        return whole

    def _add(self, topic: str, data: bytes, topics: AbstractSet[str]) -> list[dict[str, bytes]]:
        """The tick that is whole with this message, if any; not one that a simulator which waits says again."""
        before, key = self._key, turn_of(data)
        parts = self._waiting.setdefault(key, {})
        parts[topic] = data
        if topics <= parts.keys():
            del self._waiting[key]
            self._key, self.parts = key, parts
            return [parts] if key != before else []
        if len(self._waiting) > KEPT:
            del self._waiting[next(iter(self._waiting))]
        return []


def checked_tick(parts: dict[str, bytes]) -> tuple[RobotState, ControllerState | None, LearnerTerms | None]:
    """The messages of a tick; None where there is none of the controller's. Raises `Refused`."""
    messages = {name: decoded(data, TICK_TOPICS[name], {}) for name, data in parts.items()}
    state, details, terms = messages["state"], messages.get("controller_state"), messages.get("learner_terms")
    check_lengths(state, LENGTHS)
    check_finite("q", state.q)
    check_finite("foot_force", state.foot_force)
    if details and details.stance not in (0, 1):
        raise Refused("no leg", f"stance = {details.stance}; expected 0 or 1")
    return state, details, terms
