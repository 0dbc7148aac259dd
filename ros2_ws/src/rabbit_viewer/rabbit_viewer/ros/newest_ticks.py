"""The newest ticks of a graph, put together of messages that stay bytes until a picture is due."""

from collections.abc import Iterable
from collections.abc import Set as AbstractSet

from rabbit_common.message_checks import Refused, check_finite, check_lengths
from rabbit_common.ros.checked_node import decoded
from rabbit_common.ros.conversions import LENGTHS
from rabbit_msgs.msg import ControllerState, LearnerTerms, RobotState
from rabbit_recording.message_header import turn_of

TICK_TOPICS = {"state": RobotState, "controller_state": ControllerState, "learner_terms": LearnerTerms}
KEPT = 16  # ticks that wait for their last part


class NewestTicks:
    """The newest ticks of which there is a message on each of some topics; all begin with header, episode, tick.

    `parts`: of the newest tick, by topic.
    """

    def __init__(self) -> None:
        self.clear()

    def clear(self) -> None:
        """Forget all."""
        self._waiting: dict[tuple[int, int], dict[str, bytes]] = {}
        self._key: tuple[int, int] | None = None  # of the newest: episode, tick
        self.parts: dict[str, bytes] = {}

    def take(self, messages: Iterable[tuple[str, bytes]], topics: AbstractSet[str]) -> list[dict[str, bytes]]:
        """The ticks that are whole with these serialised messages, by topic, the oldest first.

        `topics` may change: a controller of another kind publishes fewer.
        """
        whole = []
        for topic, data in messages:
            key = turn_of(data)
            parts = self._waiting.setdefault(key, {})
            parts[topic] = data
            if topics <= parts.keys():
                del self._waiting[key]
                if key != self._key:  # a simulator that waits says its state again
                    whole.append(parts)
                self._key, self.parts = key, parts
            elif len(self._waiting) > KEPT:
                del self._waiting[next(iter(self._waiting))]
        return whole


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
