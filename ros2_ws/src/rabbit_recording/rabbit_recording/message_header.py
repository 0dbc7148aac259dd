"""What stands at the beginning of the graph's messages, read without decoding the rest: episode, tick, time.

After four bytes of CDR header comes the `std_msgs/Header`, seconds, nanoseconds and frame; then what `FIELDS` says.
"""

import struct
from pathlib import Path

from rabbit_recording import RecordingError

STAMP = struct.Struct("<3I")  # seconds, nanoseconds, length of the frame's name
NUMBERS = struct.Struct("<2I")  # episode; and a tick, or what else there is
TICK = ("header", "episode", "tick")
FIELDS = {  # the first of each topic's message
    **dict.fromkeys(("state", "measured", "true_state", "parameters", "torque", "timing"), TICK),
    **dict.fromkeys(("controller_state", "learner_terms"), TICK),
    "episode": ("header", "episode", "phase"),
    **dict.fromkeys(("preview", "landing"), ("header", "episode")),
}
FIRST_WORD = (0, 0)  # episode and phase with which a simulator begins: none, and WAITING in rabbit_msgs/Episode
FIRST_TICK = (1, 0)  # episode and tick


def nanoseconds_of(data: bytes) -> int:
    """A message's stamp, ns."""
    seconds, nanoseconds, _ = _stamp_and_length(data)
    return seconds * 1_000_000_000 + nanoseconds


def turn_of(data: bytes) -> tuple[int, int]:
    """Episode and tick of a `RobotState` or another message of a tick."""
    begin = _end_of_header(data)
    return NUMBERS.unpack(data[begin : begin + NUMBERS.size].ljust(NUMBERS.size, b"\0"))


def _end_of_header(data: bytes) -> int:
    return 16 + (_stamp_and_length(data)[2] + 3) // 4 * 4  # the frame's name is padded to four bytes


def _stamp_and_length(data: bytes) -> tuple[int, int, int]:
    """Zeros where the message is cut."""
    return STAMP.unpack(data[4:16].ljust(STAMP.size, b"\0"))


class SimulatedTime:
    """The time at which messages are stored: the one they carry, so that a recording has one clock; in their order.

    A simulator that is started again without a memory begins its time at 0, and a recording ends there. It says so by
    its first word, that it waits for episode 0. That is latched: a recorder that is started late also receives the one
    of the simulator that runs, whose states go on. Another's go back, to its first tick. `now`: of the newest
    state, ns.
    """

    def __init__(self, recording: Path) -> None:
        self._recording, self.now = recording, 0
        self._may_go_back = False  # a first word has come since the newest state

    def of(self, topic: str, publisher: str, data: bytes) -> int:
        """The time of a message of a `publisher` (simulator, controller, trainer, all), ns.

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
            goes_back = self.now < before
            if self._may_go_back and goes_back and turn_of(data) == FIRST_TICK:
                raise RecordingError(f"recording {self._recording}: the simulator was started again without a memory")
            self._may_go_back &= goes_back
        elif topic == "episode" and len(data) >= _end_of_header(data) + NUMBERS.size:  # one that is cut says nothing
            episode, phase = turn_of(data)
            self._may_go_back |= (episode, phase & 0xFF) == FIRST_WORD  # the phase is one byte
