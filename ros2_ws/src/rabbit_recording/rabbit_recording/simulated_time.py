"""At which time a message is stored: the simulated time that it carries, so that a recording has one clock.

A simulator that is started again without a memory begins its time at 0, and a recording ends there. It says so by its
first word, that it waits for episode 0. That is latched: a recorder that is started late also receives the one of the
simulator that runs, whose states go on. Behind another's they go back.
"""

from pathlib import Path

from rabbit_recording import RecordingError
from rabbit_recording.message_header import episode_and_phase_of, nanoseconds_of

FIRST_WORD = (0, 0)  # episode and phase with which a simulator begins: none, and WAITING in rabbit_msgs/Episode


class SimulatedTime:
    """Places the messages of a graph in the order in which they come. `now`: of the newest state, ns."""

    def __init__(self, recording: Path) -> None:
        self._recording, self.now = recording, 0
        self._may_go_back = False  # a first word has come since the newest state

    def of(self, topic: str, publisher: str, data: bytes) -> int:
        """Of a message of a `publisher` (simulator, controller, trainer, all), ns.

        Raises:
            RecordingError: the simulator was started again.
        """
        self.follow(topic, data)
        at = nanoseconds_of(data)
        # others than the simulator know no time before the first tick
        return self.now if publisher == "all" or (publisher != "simulator" and not at) else at

    def follow(self, topic: str, data: bytes) -> None:
        """Take note of a state or a first word; raises as `of`."""
        if topic == "state":
            before, self.now = self.now, nanoseconds_of(data)
            if self._may_go_back and self.now < before:
                raise RecordingError(f"recording {self._recording}: the simulator was started again without a memory")
            self._may_go_back = False
        elif topic == "episode":
            self._may_go_back |= episode_and_phase_of(data) == FIRST_WORD
