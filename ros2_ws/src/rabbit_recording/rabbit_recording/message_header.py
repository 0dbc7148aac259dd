"""What stands at the same place in the bytes of the graph's messages, read without decoding the rest.

After four bytes of CDR header comes the stamp, int32 seconds and uint32 nanoseconds; then what `FIELDS` says.
"""

TICK = ("stamp", "episode", "tick")
FIELDS = {  # the first of each topic's message
    "state": TICK,
    "measured": TICK,
    "true_state": TICK,
    "torque": (*TICK, "torque", "policy_version"),
    "controller_state": TICK,
    "episode": ("stamp", "episode", "phase"),
    "preview": ("stamp", "episode"),
    "landing": ("stamp", "episode"),
    "timing": TICK,
}


def nanoseconds_of(data: bytes) -> int:
    """A message's stamp, ns."""
    return _number(data, 4) * 1_000_000_000 + _number(data, 8)


def turn_of(data: bytes) -> tuple[int, int]:
    """Episode and tick of a `RabbitState` or another message of a tick."""
    return _number(data, 12), _number(data, 16)


def episode_and_phase_of(data: bytes) -> tuple[int, int]:
    """Of an `Episode`."""
    return _number(data, 12), data[16] if len(data) > 16 else 0


def policy_of(data: bytes) -> str:
    """The policy that made a `TorqueCommand`, by its version."""
    return data[56 : 55 + _number(data, 52)].decode(errors="replace")  # the last byte is the string's end


def _number(data: bytes, at: int) -> int:
    return int.from_bytes(data[at : at + 4], "little")
