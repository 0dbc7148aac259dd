"""Which controller's torques act: those of one controller in an episode, so that no two controllers are mixed.

A sender is what a controller writes into its torques. The empty one is a sender too; two controllers that have it show
by two answers to one tick.
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
        """Its torque is sound. Returns why it ends the episode; empty: it acts."""
        before, has_answered = self.controller, self._has_answered
        self.controller, self._has_answered, self._last = message.sender, True, message
        if message.fault or message.sender == before or not has_answered:
            return str(message.fault)
        return f"{named(message.sender)} answers in place of {named(before)}"

    def mixed(self, message: TorqueCommand) -> str:
        """Why this torque ends the episode: a tick has another answer by then, and both are without a name."""
        ours, last = ((each.episode, each.tick, each.sender) for each in (message, self._last))
        if ours != last or message.sender or list(message.torque) == list(self._last.torque):
            return ""
        return f"two controllers without a name answer tick {message.tick}: expected a `sender` of its own in each"


def named(sender: str | None) -> str:
    """A sender in a sentence."""
    return sender or "a controller without a name"
