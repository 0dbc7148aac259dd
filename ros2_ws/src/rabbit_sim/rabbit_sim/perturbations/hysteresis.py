"""Joints whose friction depends on where they turned last, by Dahl's model.

The friction f of a joint that turns by dx goes towards F in its direction:   df = k (1 - f sign(dx) / F) dx
(P. R. Dahl, "A solid friction model", Aerospace Corporation, 1968). A joint that turns back is pushed by f at first.
"""

import numpy as np
from rabbit_description.state import JOINTS, Array

from rabbit_sim.perturbation import Control, EngineNumber, Memory, Perturbation, setting
from rabbit_sim.plant import SUBSTEP_SECONDS

STIFFNESS = 500.0  # k, N m/rad


class Hysteresis(Perturbation):
    """See above."""

    order = 510

    hysteresis: EngineNumber = setting(
        0.0, 0, 100, "most of the joints' friction with memory, N m", Control("hysteresis", 1, "N m")
    )

    def begin(self, memory: Memory) -> None:
        memory.friction = np.zeros(JOINTS)

    def transmitted(self, memory: Memory, torque: Array, joints: Array, rates: Array) -> Array:
        turned = SUBSTEP_SECONDS * rates
        end = self.hysteresis * np.sign(turned)
        memory.friction = end + (memory.friction - end) * np.exp(-STIFFNESS * np.abs(turned) / self.hysteresis)
        left: Array = torque - memory.friction
        return left
