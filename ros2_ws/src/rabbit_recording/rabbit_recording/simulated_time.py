"""At which time a message is stored: the simulated time that it carries, one run of a simulator behind the other.

A simulator that is started again without a memory begins its time at 0. It says so by its first word, that it waits for
episode 0. That is latched: a recorder that is started late also receives the one of the simulator that runs. It is
another simulator's if it was sent after anything of the present one.
"""

from rabbit_description.state import TICK_NANOSECONDS

from rabbit_recording.message_header import episode_and_phase_of, nanoseconds_of
from rabbit_recording.stored_messages import FIRST_WORD


class SimulatedTime:
    """Places the messages of a simulator and its controller, in the order in which they come; all times in ns."""

    def __init__(self) -> None:
        self.now = 0  # where what carries no time is stored: with the newest state
        self._end = 0  # of what was announced
        self._runs: list[tuple[int, int]] = []  # when each run's first message was sent, where its time 0 lies

    def of(self, topic: str, publisher: str, data: bytes, sent: int) -> int:
        """Of a message of a `publisher` (simulator, controller, trainer, all), `sent` at a time of the wall clock."""
        stamp = nanoseconds_of(data)
        if publisher == "all" or (publisher != "simulator" and not stamp):  # others know no time before the first tick
            return self.now
        first, began = self._runs[0] if self._runs else (sent, 0)
        self._runs[:1] = [(min(first, sent), began)]
        if topic == "episode" and episode_and_phase_of(data) == FIRST_WORD and sent > self._runs[-1][0]:
            self.now = self._end = max(self._end, self.now) + TICK_NANOSECONDS
            self._runs.append((sent, self.now))
        # the run in which it was sent: it may come after the next one's first word
        at = stamp + next(began for first, began in reversed(self._runs) if first <= sent)
        if topic == "state":
            self.now = at
        elif topic == "episode":
            self._end = max(self._end, at)
        return at
