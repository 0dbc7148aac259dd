"""At which time a message is stored: the simulated time that it carries, one run of a simulator behind the other.

A simulator that is started again without a memory begins its time at 0. It says so by its first word, that it waits for
episode 0. That is latched: a recorder that is started late also receives the one of the simulator that runs. It is
another simulator's if it was sent after anything of the present one.
"""

from dataclasses import dataclass

from rabbit_description.state import TICK_NANOSECONDS

from rabbit_recording.message_header import episode_and_phase_of, nanoseconds_of
from rabbit_recording.stored_messages import FIRST_WORD, goes_on


@dataclass
class _Run:
    """Where its time 0 lies; when its first word was sent, any message first and its newest state; that state."""

    began: int = 0
    word_sent: int = 0
    first_sent: int | None = None
    newest_sent: int = 0
    state: bytes = b""


class SimulatedTime:
    """Places the messages of a simulator and its controller, in the order in which they come; all times in ns."""

    def __init__(self) -> None:
        self.now = 0  # where what carries no time is stored: with the newest state
        self._end = 0  # of what was announced
        self._runs = [_Run()]
        self._is_doubted = False  # no state has followed the newest run's first word yet

    def of(self, topic: str, publisher: str, data: bytes, sent: int) -> int:
        """Of a message of a `publisher` (simulator, controller, trainer, all), `sent` at a time of the wall clock."""
        if topic == "state":
            return self._of_state(data, sent)
        if topic == "episode":
            return self._of_episode(data, sent)
        is_in_time = nanoseconds_of(data) and publisher != "all"  # others know no time before the first tick
        return self._in_time(data, sent) if publisher == "simulator" or is_in_time else self.now

    def _of_state(self, data: bytes, sent: int) -> int:
        """It shows whether the first word before it was of another simulator."""
        if self._is_doubted and goes_on(self._runs[-2].state, data):
            self._runs.pop()
        self._is_doubted = False
        run = self._run(sent)
        self.now = run.began + nanoseconds_of(data)
        run.newest_sent, run.state = sent, data
        return self._in_time(data, sent)

    def _of_episode(self, data: bytes, sent: int) -> int:
        newest = self._runs[-1]
        is_later = newest.first_sent is not None and sent > newest.first_sent
        if episode_and_phase_of(data) == FIRST_WORD and is_later:
            self._is_doubted = 0 < newest.newest_sent < sent
            self.now = self._end = max(self._end, self.now) + TICK_NANOSECONDS
            self._runs.append(_Run(self.now, sent))
        at = self._in_time(data, sent)
        self._end = max(self._end, at)
        return at

    def _in_time(self, data: bytes, sent: int) -> int:
        run = self._run(sent)
        run.first_sent = sent if run.first_sent is None else min(run.first_sent, sent)
        return run.began + nanoseconds_of(data)

    def _run(self, sent: int) -> _Run:
        """The one that ran when a message was sent; it may come after the next one's first word."""
        return next((run for run in reversed(self._runs) if run.word_sent <= sent), self._runs[0])
