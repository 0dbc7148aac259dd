"""At which time a message is stored: the simulated time that it carries, one run of a simulator behind the other.

A simulator that is started again without a memory begins its time at 0. It says so by its first word, that it waits for
episode 0. That is latched: a recorder that is started late also receives the one of the simulator that runs. It is
another simulator's if it was sent after anything of the present one.
"""

from dataclasses import dataclass, replace

from rabbit_recording.header import episode_and_phase_of, nanoseconds_of
from rabbit_recording.heard import FIRST_WORD, TICK_NANOSECONDS, goes_on


@dataclass(frozen=True)
class _Run:
    """Where its time 0 lies; when its first message and its newest state were sent; that state."""

    began: int = 0
    first_sent: int | None = None
    newest_sent: int = 0
    state: bytes = b""


class SimulatedTime:
    """Places the messages of a simulator and its controller, in the order in which they come; all times in ns."""

    def __init__(self) -> None:
        self.now = 0  # where what carries no time is stored: with the newest state
        self._end = 0  # of what was announced
        self._run = _Run()
        self._before: _Run | None = None  # the run in which the newest first word came

    def of(self, topic: str, publisher: str, data: bytes, sent: int) -> int:
        """Of a message of a `publisher` (simulator, controller, trainer, all), `sent` at a time of the wall clock."""
        if topic == "state":
            return self._of_state(data, sent)
        if topic == "episode":
            return self._of_episode(data, sent)
        if publisher == "simulator":
            return self._of_simulator(data, sent)
        stamp = nanoseconds_of(data)
        is_simulated = stamp and publisher != "all"  # a controller or trainer knows no time before the first tick
        return self._run.began + stamp if is_simulated else self.now

    def _of_state(self, data: bytes, sent: int) -> int:
        """It shows whether the first word before it was of another simulator."""
        if self._before is not None and goes_on(self._before.state, data):
            self._run = self._before
        self._before = None
        run = self._run
        self.now = run.began + nanoseconds_of(data)
        self._run = replace(run, newest_sent=sent, state=data)
        self._hear(sent)
        return self.now

    def _of_episode(self, data: bytes, sent: int) -> int:
        run = self._run
        if episode_and_phase_of(data) == FIRST_WORD and run.first_sent is not None and sent > run.first_sent:
            self._before = run if 0 < run.newest_sent < sent else None
            self.now = self._end = max(self._end, self.now) + TICK_NANOSECONDS
            self._run = _Run(self.now)
        at = self._of_simulator(data, sent)
        self._end = max(self._end, at)
        return at

    def _of_simulator(self, data: bytes, sent: int) -> int:
        self._hear(sent)
        return self._run.began + nanoseconds_of(data)

    def _hear(self, sent: int) -> None:
        first = self._run.first_sent
        if first is None or sent < first:
            self._run = replace(self._run, first_sent=sent)
