"""Who may answer a state, and for how long nobody has.

A killed controller stays in the graph for 20 s, so being there is not enough.
"""

import time

from rclpy.node import Node
from rclpy.subscription import Subscription

LOOK_SECONDS = 0.02  # between looks at who is there and what is late
REPEAT_SECONDS = 0.5  # without an answer, after which a state is sent again: its reader may just have come
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


class Wait:
    """For a torque or a plan. Time in which this process itself stood still does not count."""

    def __init__(self) -> None:
        self._looked = time.monotonic()
        self.begin()

    def begin(self) -> None:
        """Something else is awaited from now on."""
        self._since: float | None = time.monotonic()
        self.reminders = 0

    def give_up(self) -> None:
        """What is awaited may come at any time."""
        self._since = None

    @property
    def seconds(self) -> float:
        """How long it has lasted."""
        return 0.0 if self._since is None else time.monotonic() - self._since

    def look(self) -> None:
        """Call it every `LOOK_SECONDS`: while this process did not, nobody was late."""
        stood_still = time.monotonic() - self._looked - LOOK_SECONDS
        self._looked += stood_still + LOOK_SECONDS
        if self._since is not None and stood_still > REPEAT_SECONDS:
            self._since += stood_still

    def is_reminder_due(self) -> bool:
        """Every `REPEAT_SECONDS`; counts them."""
        is_due = self.seconds > (self.reminders + 1) * REPEAT_SECONDS
        self.reminders += is_due
        return is_due
