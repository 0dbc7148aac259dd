"""Which controller's torques act: those of one controller in an episode, so that no two laws are mixed.

A sender is what a controller writes into its torques. The empty one is a sender too.
"""

from rabbit_common.message_checks import Refused
from rabbit_msgs.msg import TorqueCommand


class ControllerAdmission:
    """`controller`: the sender whose torques act, None before the first; `refused`: another of this episode, or empty.

    The controller of the last episode is expected first. Another one is heard only if a tick had to be asked again. It
    is then admitted, or, in the middle of an episode, ends it: nobody knows which leg it takes for the stance leg.
    """

    def __init__(self) -> None:
        self.controller: str | None = None
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
        """Its torque is sound. Returns why it ends the episode; empty: it acts."""
        before, has_answered = self.controller, self._has_answered
        self.controller, self._has_answered = message.sender, True
        if message.fault or message.sender == before or not has_answered:
            return str(message.fault)
        return f"{named(message.sender)} answers in place of {named(before)}"


def named(sender: str | None) -> str:
    """A sender in a sentence."""
    return sender or "a controller without a name"
