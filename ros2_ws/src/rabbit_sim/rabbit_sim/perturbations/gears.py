"""Elastic gears with play: a rotor of inertia J at each joint drives it through a spring k and a damper c.

With s = rotor - joint the joint gets k (s -+ b / 2) + c s' outside of the play b, and nothing within it. A tooth does
not pull; without play the spring does.
"""

from math import radians, sqrt

import numpy as np
from rabbit_description.state import Array

from rabbit_sim.perturbation import Control, EngineNumber, Perturbation, Transmission, setting
from rabbit_sim.plant import SUBSTEP_SECONDS

ROTOR_INERTIA = 0.05  # kg m^2, reflected
GEAR_STIFFNESS = 5000.0  # N m/rad
GEAR_DAMPING_RATIO = 0.2  # of a rotor against a joint that stands still


class Gears(Perturbation):
    """See above."""

    gear_stiffness: EngineNumber = setting(
        0.0, 0, 2e4, "of elastic joints, N m/rad; 0: rigid", Control("gear stiffness, 0: rigid", 100, "N m/rad")
    )
    backlash: EngineNumber = setting(
        0.0, 0, 5, "play of each joint's gear from side to side, degrees", Control("backlash", 0.1, "degrees")
    )

    def transmission(self) -> Transmission:
        return Rotors(self.backlash, self.gear_stiffness)


class Rotors:
    """Those of the four joints."""

    def __init__(self, backlash: float, stiffness: float) -> None:
        """`backlash` in degrees; `stiffness` in N m/rad, 0 for `GEAR_STIFFNESS`."""
        self._half = radians(backlash) / 2
        self._stiffness = stiffness or GEAR_STIFFNESS
        self._damper = 2 * GEAR_DAMPING_RATIO * sqrt(self._stiffness * ROTOR_INERTIA)

    def reset(self, joints: Array, rates: Array) -> None:
        """In the middle of the play, where the joints are, and as fast."""
        self._rotor, self._rate = joints.copy(), rates.copy()

    def transmitted(self, torque: Array, joints: Array, rates: Array) -> Array:
        """To the joints over the next substep, in which the motors give `torque`."""
        slip, slip_rate = self._rotor - joints, self._rate - rates
        beyond = slip - slip.clip(-self._half, self._half)
        passed: Array = self._stiffness * beyond + self._damper * slip_rate
        if self._half:
            side = np.sign(beyond)
            passed = side * np.maximum(side * passed, 0.0)
        self._rate = self._rate + SUBSTEP_SECONDS * (torque - passed) / ROTOR_INERTIA
        self._rotor = self._rotor + SUBSTEP_SECONDS * self._rate
        return passed
