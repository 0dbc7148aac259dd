"""Which encoders are used in a tick: a gate refuses a reading that cannot be.

A joint's innovation nu (2,), of its angle and its rate, has the covariance S. The gate refuses it where

    nu' S^-1 nu > GATE^2    or    |nu_1| > max(JUMP, 2 sqrt(S_11))

The first is the usual one (Bar-Shalom, Li, Kirubarajan 2001, section 5.7). For a Gaussian, GATE = 5 would do; an
impact's innovation is not Gaussian, and reached 15 in 10,572 ticks on twenty plants. The second one holds in the tick
of an impact, when S is large: on those plants no impact changed a rate by more than 22 rad/s, or moved an angle by more
than 0.17 rad from where it was expected (3,929 ticks).
An encoder that was refused for `PATIENCE` seconds in a row may have slipped: its zero is then no longer known, so that
it is used again.
"""

from dataclasses import dataclass

import numpy as np
from rabbit_description.state import JOINTS, TICK_SECONDS, Array
from rabbit_description.tick import ticks_in

GATE = 20.0
JUMP = 0.2  # rad
PATIENCE = 0.05  # s


@dataclass(frozen=True)
class Innovation:
    """What a tick measured less what the filter expected, (m,), and its covariance, (m, m).

    The first four are the encoders' angles, the next four their rates.
    """

    value: Array
    covariance: Array

    @property
    def nis(self) -> float:
        """Normalised innovation squared: chi-square with m degrees of freedom for a consistent filter."""
        return float(self.value @ np.linalg.solve(self.covariance, self.value))


class EncoderGate:
    """`refused` (4,): for how many ticks in a row each joint has been."""

    def __init__(self, tick_seconds: float = TICK_SECONDS) -> None:
        self._patience = ticks_in(PATIENCE, tick_seconds)
        self.refused = np.zeros(JOINTS, dtype=int)

    def accepted(self, innovation: Innovation) -> Array:
        """Which rows of the innovation, (m,) of bool, are to be used."""
        rows = np.ones(len(innovation.value), dtype=bool)
        for joint in range(JOINTS):
            own = [joint, JOINTS + joint]
            value, covariance = innovation.value[own], innovation.covariance[np.ix_(own, own)]
            far = value @ np.linalg.solve(covariance, value) > GATE**2
            rows[own] = not far and abs(value[0]) <= max(JUMP, 2 * np.sqrt(covariance[0, 0]))
            self.refused[joint] = 0 if rows[joint] else self.refused[joint] + 1
        return rows

    def lost(self) -> list[int]:
        """Joints whose encoder has been refused for too long."""
        return np.flatnonzero(self.refused >= self._patience).tolist()
