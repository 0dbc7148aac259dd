"""Elastic gears with play: a rotor of inertia J at each joint drives it through a spring k and a damper c.

With s = rotor - joint the joint gets k (s -+ b / 2) + c s' outside of the play b, and nothing within it. A tooth does
not pull; without play the spring does.
"""

from functools import cached_property
from math import radians, sqrt

import numpy as np
from rabbit_description.state import Array

from rabbit_sim.perturbation import Control, EngineNumber, Memory, Perturbation, setting
from rabbit_sim.plant import SUBSTEP_SECONDS

ROTOR_INERTIA = 0.05  # kg m^2, reflected
GEAR_STIFFNESS = 5000.0  # N m/rad
GEAR_DAMPING_RATIO = 0.2  # of a rotor against a joint that stands still


class Gears(Perturbation):
    """See above. A rotor begins in the middle of the play, where its joint is, and as fast."""

    gear_stiffness: EngineNumber = setting(
        0.0,
        0,
        2e4,
        "stiffness of elastic joints, N m/rad; 0: rigid",
        Control("gear stiffness, 0: rigid", 100, "N m/rad"),
    )
    backlash: EngineNumber = setting(
        0.0, 0, 5, "play of each joint's gear from side to side, degrees", Control("backlash", 0.1, "degrees")
    )

    @cached_property
    def _spring(self) -> tuple[float, float, float]:
        """Half the play, rad; k, N m/rad; c, N m s/rad."""
        stiffness = self.gear_stiffness or GEAR_STIFFNESS
        return radians(self.backlash) / 2, stiffness, 2 * GEAR_DAMPING_RATIO * sqrt(stiffness * ROTOR_INERTIA)

    def transmitted(self, memory: Memory, torque: Array, joints: Array, rates: Array) -> Array:
        half, stiffness, damper = self._spring
        slip, slip_rate = memory.joints - joints, memory.rates - rates  # of the rotors, which were there at the reset
        beyond = slip - slip.clip(-half, half)
        passed: Array = stiffness * beyond + damper * slip_rate
        if half:
            side = np.sign(beyond)
            passed = side * np.maximum(side * passed, 0.0)
        memory.rates = memory.rates + SUBSTEP_SECONDS * (torque - passed) / ROTOR_INERTIA
        memory.joints = memory.joints + SUBSTEP_SECONDS * memory.rates
        return passed
