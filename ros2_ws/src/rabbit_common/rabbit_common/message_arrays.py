"""Arrays of messages: their lengths are the robot's, which the messages themselves do not fix."""

from array import array
from collections.abc import Mapping
from typing import Any

import numpy as np
from rabbit_description.state import Array

from rabbit_common.message_checks import Refused


def doubles(values: Array) -> "array[float]":
    """For a sequence of a message: copied at once, where rclpy would ask a numpy array for each number."""
    return array("d", np.asarray(values, dtype=np.float64).tobytes())


def array_of(message: Any, name: str, length: int) -> Array:
    """A message's array, (length,); raises `Refused`."""
    check_lengths(message, {name: length})
    return np.array(getattr(message, name))


def check_lengths(message: Any, lengths: Mapping[str, int]) -> None:
    """Refuse arrays of other lengths than these, by field."""
    for name, length in lengths.items():
        if (got := len(getattr(message, name))) != length:
            raise Refused("wrong length", f"{name} has {got} values; expected {length}")
