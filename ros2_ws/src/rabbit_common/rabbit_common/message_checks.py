"""Every message is checked before it is used; every refusal is counted and reported.

Lengths of arrays are the robot's, which the messages themselves do not fix.
"""

import math
from array import array
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from rabbit_description.state import LAYOUT, Array, RobotLayout


class Refused(ValueError):
    """A message that is not used. `reason` is the short name it is counted under."""

    def __init__(self, reason: str, text: str) -> None:
        super().__init__(f"{reason}: {text}")
        self.reason = reason


@dataclass
class MessageCounter:
    """Counts what came in and what was refused, by topic and reason."""

    accepted: Counter[str] = field(default_factory=Counter)
    refused: Counter[str] = field(default_factory=Counter)
    last_refusal: str = ""

    def accept(self, topic: str) -> None:
        """Count a message that is used."""
        self.accepted[topic] += 1

    def refuse(self, topic: str, error: Refused) -> str:
        """Count a refusal; returns the line for the log."""
        self.refused[f"{topic}: {error.reason}"] += 1
        self.last_refusal = f"{topic} refused, {error}"
        return self.last_refusal


def check_finite(name: str, values: Sequence[float]) -> None:
    """Refuse NaN and infinities."""
    if all(map(math.isfinite, values)):  # of a few numbers in a tenth of numpy's time
        return
    for i, value in enumerate(values):
        if not math.isfinite(value):
            raise Refused("not finite", f"{name}[{i}] = {value}; expected a finite number")


def check_turn(got: tuple[int, int], expected: tuple[int, int]) -> None:
    """Refuse a message for another (episode, tick) than the one awaited."""
    if got[0] != expected[0]:
        raise Refused("wrong episode", f"episode {got[0]}, tick {got[1]}; expected episode {expected[0]}")
    if got[1] != expected[1]:
        raise Refused("wrong tick", f"tick {got[1]} of episode {got[0]}; expected tick {expected[1]}")


def doubles(values: Array) -> "array[float]":
    """The array for a sequence of a message: copied at once, where rclpy would ask for each number."""
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


def check_state(message: Any, finite: bool = True, layout: RobotLayout = LAYOUT) -> None:
    """Refuse another robot's lengths, and what is not finite.

    An episode's last state may be anything (`finite` False): the plant may diverge.
    """
    check_lengths(message, layout.lengths)
    for name in ("q", "dq", "foot_force") if finite else ():
        if name != "dq" or layout.has_rates:
            check_finite(name, getattr(message, name))
