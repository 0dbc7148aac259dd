"""Who may answer a state, whose answer acts, and for how long nobody has answered.

The torques of one controller act in an episode, so that no two are mixed. A sender is what a controller writes into its
torques. The empty one is a sender too; two controllers that have it show by two answers to one tick.
"""

import time

from rabbit_common.message_checks import Refused
from rabbit_msgs.msg import TorqueCommand
from rclpy.node import Node
from rclpy.subscription import Subscription

LOOK_SECONDS = 0.02  # between looks at who is there and what is late
REPEAT_SECONDS = 0.5  # without an answer, after which a state is sent again: its reader may just have come
DEAD_SECONDS = 25.0  # after which the graph has forgotten a dead one: who is still there lives


class LiveControllers:
    """The publishers of torques, but for those that were asked and said nothing: until one speaks, or for 25 s.

    A killed controller stays in the graph for 20 s, so being there is not enough.
    One that comes while a tick waits for another's answer has not been asked from the start: it keeps its chance.
    """

    def __init__(self, node: Node, torques: Subscription) -> None:
        self._node, self._torques = node, torques
        self._asked: frozenset[bytes] | None = None
        self._deaf: frozenset[bytes] = frozenset()
        self._since = 0.0  # since when they are deaf

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
        publishers = self._node.get_publishers_info_by_topic(self._torques.topic_name)
        return frozenset(bytes(publisher.endpoint_gid) for publisher in publishers)


class ControllerAdmission:
    """`controller`: the sender whose torques act, None before the first; `refused`: another of this episode, or empty.

    The controller of the last episode is expected first. Another one is heard only if a tick had to be asked again. It
    is then admitted, or, in the middle of an episode, ends it: nobody knows which leg it takes for the stance leg.
    """

    def __init__(self) -> None:
        self.controller: str | None = None
        self._last = TorqueCommand()
        self.begin()

    def begin(self) -> None:
        """Another episode."""
        self._has_answered, self.refused = False, ""

    def check(self, sender: str, is_asked_again: bool) -> None:
        """Raise `Refused` for a torque of another controller while the admitted one may answer."""
        if is_asked_again or self.controller in (None, sender):
            return
        if self._has_answered:
            self.refused = named(sender)
        raise Refused("another controller", f"{named(sender)}; this episode is walked by {named(self.controller)}")

    def admit(self, message: TorqueCommand) -> str:
        """Admits a sound torque. Returns why it ends the episode; empty: it acts."""
        before, has_answered = self.controller, self._has_answered
        self.controller, self._has_answered, self._last = message.sender, True, message
        if message.fault or message.sender == before or not has_answered:
            return str(message.fault)
        return f"{named(message.sender)} answers in place of {named(before)}"

    def mixed(self, message: TorqueCommand) -> str:
        """Why this torque ends the episode: a tick has another answer by then, and both are without a name."""
        last = self._last
        if message.sender or last.sender or (message.episode, message.tick) != (last.episode, last.tick):
            return ""
        if message.torque == last.torque:
            return ""
        return f"two controllers without a name answer tick {message.tick}: expected a `sender` of its own in each"


def named(sender: str | None) -> str:
    """A sender in a sentence."""
    return sender or "a controller without a name"


class Wait:
    """Waits for a torque or a plan. Time in which this process itself stood still does not count."""

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
