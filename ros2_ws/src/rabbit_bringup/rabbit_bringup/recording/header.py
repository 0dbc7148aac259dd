"""What stands at the same place in the bytes of the graph's messages, read without decoding the rest.

After four bytes of CDR header comes the stamp, int32 seconds and uint32 nanoseconds; in a state then episode and tick.
"""


def time_of(data: bytes) -> tuple[int, int]:
    """Seconds and nanoseconds of a message's stamp."""
    return _number(data, 4), _number(data, 8)


def turn_of(data: bytes) -> tuple[int, int]:
    """Episode and tick of a `RabbitState`."""
    return _number(data, 12), _number(data, 16)


def _number(data: bytes, at: int) -> int:
    return int.from_bytes(data[at : at + 4], "little")
