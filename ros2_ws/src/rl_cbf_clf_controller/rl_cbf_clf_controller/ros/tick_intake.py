"""States, announcements and what is announced with a state, in whatever order they come: which one is to be answered.

A state of an episode that is not announced yet is kept until it is: the topics may overtake each other. Of previews
one is kept for each stone, of the present episode and of the one that may come next. By their stamps a foreign copy of
another stone's preview is known, see `newest_preview`. A task's parameters are those of the very tick.
"""

import math

from cbf_clf_qp.functions import Array
from rabbit_common.message_checks import Refused, check_state, check_turn
from rabbit_common.ros.conversions import Announcements, is_unknown, nanoseconds, other_tick, preview_of
from rabbit_common.task_messages import parameters_of
from rabbit_description.state import LAYOUT, TICK_SECONDS, RobotState, StonePreview, newest_preview
from rabbit_description.task import ControlTask
from rabbit_description.task_state import layout_of
from rabbit_msgs.msg import Episode, TaskParameters
from rabbit_msgs.msg import RobotState as StateMessage
from rabbit_msgs.msg import StonePreview as PreviewMessage

NEWEST = 20  # previews of an episode, as many as are latched
EPISODES = 3  # of another one too, for a present episode that was not heard of yet
CANDIDATES = 5  # for a stone


class TickIntake:
    """`held`: the state to be answered; `early`: one that waits for its announcement; None where there is none.

    `turn`: episode and tick of the newest state; `episode`: the newest announcement.
    """

    def __init__(self, tick_seconds: float = TICK_SECONDS, task: ControlTask | None = None) -> None:
        """`task`: whose states they are; None: RABBIT's."""
        self._tick_seconds, self._task = tick_seconds, task
        self._layout = layout_of(task) if task else LAYOUT
        self.episode = Episode(sigma=math.nan)
        self.early: StateMessage | None = None
        self._announcements = Announcements(self._layout)
        self._forget()

    def _forget(self) -> None:
        """A simulator that nobody has heard of yet."""
        self.turn = (0, -1)
        self.held: StateMessage | None = None
        self._previews, self._since = PreviewBuffer(), -1  # ns: when the newest state was answered
        self._parameters = dict[tuple[int, int], Array]()  # of a task, by tick

    def take(self, message: StateMessage) -> str | None:
        """Hold a new state. Returns why its episode must end, empty: it goes on; None: it is kept as an early one.

        Raises:
            Refused: not finite, or another tick than the next one.
        """
        turn, announced = (message.episode, message.tick), self.episode.episode
        unknown = message.running and is_unknown(message)
        check_state(message, message.running and not unknown, self._layout)
        if message.episode > announced:
            self.early = message
            return None
        begins = self.turn[0] < message.episode == announced
        fault = other_tick(self.episode, self._tick_seconds) if begins and message.running else ""
        joins = begins and message.running and message.tick > 0
        if joins and not self._task:  # a task has no memory
            fault = f"the controller came in at tick {message.tick}, in the middle of the episode"
        if not fault:
            follows = (begins and message.tick == 0) or (joins and self._task)
            check_turn(turn, turn if follows else (self.turn[0], self.turn[1] + 1))
            if unknown:
                fault = f"the state of tick {message.tick} is not known: see the estimator's log"
        self._announcements.went_on()
        self.turn, self.early = turn, None
        self.held = message if message.running and not fault else None
        return fault

    def announce(self, message: Episode) -> StateMessage | None:
        """Another announcement. Returns the state that was early for it; raises `Refused`."""
        if self._announcements.check(message, self.turn[0]):
            self._forget()
        self.episode = message
        early = self.early
        if early is None or early.episode != message.episode:
            return None
        self.early = None
        return early

    def keep_preview(self, message: PreviewMessage) -> None:
        """Keeps it for the state that needs it; raises `Refused`."""
        self._previews.add(message.episode, preview_of(message), nanoseconds(message.header.stamp), self.turn[0])

    def keep_parameters(self, message: TaskParameters) -> None:
        """Keeps them for the state of the same tick; raises `Refused`."""
        assert self._task
        self._parameters[message.episode, message.tick] = parameters_of(self._task, message)
        if len(self._parameters) > NEWEST:
            del self._parameters[next(iter(self._parameters))]

    def missing(self, message: StateMessage) -> str:
        """What this state still waits for; empty: it has its preview, or its parameters."""
        if self._task:
            is_here = not self._task.commanded or (message.episode, message.tick) in self._parameters
            return "" if is_here else "parameters"
        return f"preview of stone {message.touchdowns + 1}" if message.previewed and not self._preview(message) else ""

    def complete(self, message: StateMessage) -> RobotState:
        """The held state with its preview: it is answered now."""
        state = RobotState.of_message(message, None if self._task else self._preview(message))
        if self._task:
            p = self._parameters.pop((message.episode, message.tick), None)
            state.parameters = self._task.parameters_at({}, {}) if p is None else p
        self.held, self._since = None, nanoseconds(message.header.stamp)
        return state

    def _preview(self, message: StateMessage) -> StonePreview | None:
        """The preview of the stone that this tick steps to."""
        stone, now = message.touchdowns + 1, nanoseconds(message.header.stamp)
        return self._previews.get(message.episode, stone, self._since, now)


class PreviewBuffer:
    """Keeps previews by episode, index of the stone and stamp, ns."""

    def __init__(self) -> None:
        self._episodes: dict[int, dict[int, dict[int, StonePreview]]] = {}
        self._used: tuple[int, StonePreview] | None = None  # by the newest state, with its episode

    def add(self, episode: int, stone: StonePreview, stamp: int, present: int) -> None:
        """Keep a preview while episode `present` is walked.

        Raises:
            Refused: a stone of an earlier episode, or with other edges than it had before.
        """
        if episode < present:
            raise Refused("late", f"stone {stone.index} of episode {episode}; expected {present} or later")
        stones = self._episodes.setdefault(episode, {})
        candidates = stones.setdefault(stone.index, {})
        before = candidates.setdefault(stamp, stone)
        if before != stone:
            raise Refused("told otherwise", f"{stone} of episode {episode}; it was {before}")
        if len(candidates) > CANDIDATES:
            del candidates[next(iter(candidates))]
        if len(stones) > NEWEST:
            del stones[min(stones)]
        if len(self._episodes) > EPISODES:
            wanted = (present, present + 1)
            del self._episodes[min(self._episodes, key=lambda number: (number in wanted, number))]

    def get(self, episode: int, index: int, since: int, now: int) -> StonePreview | None:
        """The stone that a state stamped `now` needs, where the last one was stamped `since`; None: not here yet."""
        if self._used is not None and (self._used[0], self._used[1].index) == (episode, index):
            return self._used[1]
        preview = newest_preview(self._episodes.get(episode, {}).get(index, {}), now, since)
        if preview is not None:
            self._used = episode, preview
        return preview
