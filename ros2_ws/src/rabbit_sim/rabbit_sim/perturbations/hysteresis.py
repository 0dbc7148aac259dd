"""Joints whose friction depends on where they turned last, by Dahl's model.

The friction f of a joint that turns by dx goes towards F in its direction:   df = k (1 - f sign(dx) / F) dx
(P. R. Dahl, "A solid friction model", Aerospace Corporation, 1968). A joint that turns back is pushed by f at first.
"""

import numpy as np
from rabbit_description.state import Array

from rabbit_sim.perturbation import Control, EngineNumber, Perturbation, Transmission, setting
from rabbit_sim.plant import SUBSTEP_SECONDS

STIFFNESS = 500.0  # k, N m/rad


class Hysteresis(Perturbation):
    """See above."""

    order = 510

    hysteresis: EngineNumber = setting(
        0.0, 0, 100, "most of the joints' friction with memory, N m", Control("hysteresis", 1, "N m")
    )

    def transmission(self) -> Transmission | None:
        return DahlFriction(self.hysteresis) if self.hysteresis else None


class DahlFriction:
    """Of the four joints; `largest` is F, N m."""

    def __init__(self, largest: float) -> None:
        self._largest = largest

    def reset(self, joints: Array, rates: Array) -> None:
        """No friction yet."""
        self._friction = np.zeros(4)

    def transmitted(self, torque: Array, joints: Array, rates: Array) -> Array:
        """What is left of `torque` over the next substep, in which the joints turn at these rates."""
        turned = SUBSTEP_SECONDS * rates
        end = self._largest * np.sign(turned)
        self._friction = end + (self._friction - end) * np.exp(-STIFFNESS * np.abs(turned) / self._largest)
        return torque - self._friction
