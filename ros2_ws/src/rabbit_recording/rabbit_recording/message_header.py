"""What stands at the same place in the bytes of the graph's messages, read without decoding the rest.

After four bytes of CDR header comes the stamp, seconds and nanoseconds; then what `FIELDS` says.
"""

import struct

HEAD = struct.Struct("<4I")  # seconds, nanoseconds, episode; and a tick, or what else there is
TICK = ("stamp", "episode", "tick")
FIELDS = {  # the first of each topic's message
    **dict.fromkeys(("state", "measured", "true_state", "controller_state", "timing"), TICK),
    "torque": (*TICK, "torque", "policy_version"),
    "episode": ("stamp", "episode", "phase"),
    **dict.fromkeys(("preview", "landing"), ("stamp", "episode")),
}


def nanoseconds_of(data: bytes) -> int:
    """A message's stamp, ns."""
    seconds, nanoseconds, *_ = _head(data)
    return seconds * 1_000_000_000 + nanoseconds


def turn_of(data: bytes) -> tuple[int, int]:
    """Episode and tick of a `RabbitState` or another message of a tick."""
    return _head(data)[2:]


def episode_and_phase_of(data: bytes) -> tuple[int, int]:
    """Of an `Episode`."""
    return _head(data)[2], data[16] if len(data) > 16 else 0


def policy_of(data: bytes) -> str:
    """The policy that made a `TorqueCommand`, by its version."""
    length = int.from_bytes(data[52:56], "little")
    return data[56 : 55 + length].decode(errors="replace")  # the last byte is the string's end


def _head(data: bytes) -> tuple[int, int, int, int]:
    """The first four numbers; zeros where the message is cut."""
    return HEAD.unpack(data[4:20].ljust(HEAD.size, b"\0"))
