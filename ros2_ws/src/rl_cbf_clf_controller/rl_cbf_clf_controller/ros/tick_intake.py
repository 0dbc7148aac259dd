"""States, previews and announcements, in whatever order they come: which state is to be answered, and with what.

A state of an episode that is not announced yet is kept until it is: the two topics may overtake each other.
"""

import math

from rabbit_common.message_checks import check_turn
from rabbit_common.ros.conversions import (
    check_episode,
    check_state,
    is_new_simulator,
    is_unknown,
    nanoseconds,
    preview_of,
)
from rabbit_description.state import RobotState, StonePreview
from rabbit_msgs.msg import Episode
from rabbit_msgs.msg import RobotState as StateMessage
from rabbit_msgs.msg import StonePreview as PreviewMessage

from rl_cbf_clf_controller.ros.preview_buffer import PreviewBuffer


class TickIntake:
    """`held`: the state to be answered; `early`: one that waits for its announcement; None where there is none.

    `turn`: episode and tick of the newest state; `episode`: the newest announcement.
    """

    def __init__(self) -> None:
        self.episode = Episode(sigma=math.nan)
        self.early: StateMessage | None = None
        self._forget()

    def _forget(self) -> None:
        """A simulator that nobody has heard of yet."""
        self.turn = (0, -1)
        self.held: StateMessage | None = None
        self._previews, self._since = PreviewBuffer(), -1  # ns: when the newest state was answered

    def take(self, message: StateMessage) -> str | None:
        """Hold a new state. Returns why its episode must end, empty: it goes on; None: it is kept as an early one.

        Raises:
            Refused: not finite, or another tick than the next one.
        """
        turn, announced = (message.episode, message.tick), self.episode.episode
        unknown = message.running and is_unknown(message)
        check_state(message, finite=message.running and not unknown)
        if message.episode > announced:
            self.early = message
            return None
        begins = self.turn[0] < message.episode == announced
        fault = ""
        if begins and message.running and message.tick > 0:
            fault = f"the controller came in at tick {message.tick}, in the middle of the episode"
        else:
            check_turn(turn, turn if begins and message.tick == 0 else (self.turn[0], self.turn[1] + 1))
            if unknown:
                fault = f"the state of tick {message.tick} is not known: see the estimator's log"
        self.turn, self.early = turn, None
        self.held = message if message.running and not fault else None
        return fault

    def announce(self, message: Episode) -> StateMessage | None:
        """Another announcement. Returns the state that was early for it; raises `Refused`."""
        check_episode(message, self.turn[0])
        if is_new_simulator(message) and self.turn[0] > 0:
            self._forget()
        self.episode = message
        early = self.early
        if early is None or early.episode != message.episode:
            return None
        self.early = None
        return early

    def keep_preview(self, message: PreviewMessage) -> None:
        """For the state that needs it; raises `Refused`."""
        self._previews.add(message.episode, preview_of(message), nanoseconds(message.header.stamp), self.turn[0])

    def missing_preview(self, message: StateMessage) -> str:
        """What this state still waits for; empty: it has its preview."""
        return f"preview of stone {message.touchdowns + 1}" if message.previewed and not self._preview(message) else ""

    def complete(self, message: StateMessage) -> RobotState:
        """The held state with its preview: it is answered now."""
        state = RobotState.of_message(message, self._preview(message))
        self.held, self._since = None, nanoseconds(message.header.stamp)
        return state

    def _preview(self, message: StateMessage) -> StonePreview | None:
        """Of the stone that this tick steps to."""
        stone, now = message.touchdowns + 1, nanoseconds(message.header.stamp)
        return self._previews.get(message.episode, stone, self._since, now)
