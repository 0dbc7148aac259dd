"""The newest ticks of a graph, put together of messages that stay bytes until a picture is due."""

from collections.abc import Iterable

from rabbit_common.message_checks import Refused, check_finite, check_lengths
from rabbit_common.ros.checked_node import decoded
from rabbit_common.ros.conversions import LENGTHS
from rabbit_msgs.msg import ControllerState, LearnerTerms, RobotState
from rabbit_recording.message_header import turn_of

TICK_TOPICS = {"state": RobotState, "controller_state": ControllerState, "learner_terms": LearnerTerms}
KEPT = 16  # ticks that wait for their last part


class NewestTicks:
    """The newest ticks of which there is a message on each of `topics`; all begin with header, episode, tick.

    `topics` may change: a controller of another kind publishes fewer.
    `parts`: of tick `key` (episode, tick), the newest; `earlier`: of the ticks since the last `take`, the oldest first.
    """

    def __init__(self, *topics: str) -> None:
        self.topics = frozenset(topics)
        self.clear()

    def clear(self) -> None:
        """Forget all."""
        self._waiting: dict[tuple[int, int], dict[str, bytes]] = {}
        self.key: tuple[int, int] | None = None  # episode, tick
        self.parts: dict[str, bytes] = {}
        self.earlier: list[dict[str, bytes]] = []

    def take(self, messages: Iterable[tuple[str, bytes]]) -> None:
        """Take what waits: topics and serialised messages."""
        self.earlier, shown = [], self.key
        for topic, data in messages:
            self.add(topic, data)
        if shown is not None and self.earlier:
            self.earlier.pop(0)  # the newest of the last time

    def add(self, topic: str, data: bytes) -> None:
        """Take a serialised message."""
        key = turn_of(data)
        parts = self._waiting.setdefault(key, {})
        parts[topic] = data
        if self.topics <= parts.keys():
            if self.parts:
                self.earlier.append(self.parts)
            self.key, self.parts = key, self._waiting.pop(key)
        elif len(self._waiting) > KEPT:
            del self._waiting[next(iter(self._waiting))]


def checked_tick(parts: dict[str, bytes]) -> tuple[RobotState, ControllerState | None, LearnerTerms | None]:
    """The messages of a tick; None where there is none of the controller's. Raises `Refused`."""
    found = {name: decoded(data, TICK_TOPICS[name], {}) for name, data in parts.items()}
    state, details, terms = found["state"], found.get("controller_state"), found.get("learner_terms")
    check_lengths(state, LENGTHS)
    check_finite("q", state.q)
    check_finite("foot_force", state.foot_force)
    if details and details.stance not in (0, 1):
        raise Refused("no leg", f"stance = {details.stance}; expected 0 or 1")
    return state, details, terms
