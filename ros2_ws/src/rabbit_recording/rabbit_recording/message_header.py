"""What stands at the beginning of the graph's messages, read without decoding the rest.

After four bytes of CDR header comes the `std_msgs/Header`, seconds, nanoseconds and frame; then what `FIELDS` says.
"""

import struct

STAMP = struct.Struct("<3I")  # seconds, nanoseconds, length of the frame's name
NUMBERS = struct.Struct("<2I")  # episode; and a tick, or what else there is
TICK = ("header", "episode", "tick")
FIELDS = {  # the first of each topic's message
    **dict.fromkeys(("state", "measured", "true_state", "controller_state", "learner_terms", "torque", "timing"), TICK),
    "episode": ("header", "episode", "phase"),
    **dict.fromkeys(("preview", "landing"), ("header", "episode")),
}


def nanoseconds_of(data: bytes) -> int:
    """A message's stamp, ns."""
    seconds, nanoseconds, _ = _stamp_and_length(data)
    return seconds * 1_000_000_000 + nanoseconds


def turn_of(data: bytes) -> tuple[int, int]:
    """Episode and tick of a `RobotState` or another message of a tick."""
    begin = 16 + (_stamp_and_length(data)[2] + 3) // 4 * 4  # the frame's name is padded to four bytes
    return NUMBERS.unpack(data[begin : begin + NUMBERS.size].ljust(NUMBERS.size, b"\0"))


def episode_and_phase_of(data: bytes) -> tuple[int, int]:
    """Of an `Episode`, whose phase is one byte."""
    episode, phase = turn_of(data)
    return episode, phase & 0xFF


def _stamp_and_length(data: bytes) -> tuple[int, int, int]:
    """Zeros where the message is cut."""
    return STAMP.unpack(data[4:16].ljust(STAMP.size, b"\0"))
