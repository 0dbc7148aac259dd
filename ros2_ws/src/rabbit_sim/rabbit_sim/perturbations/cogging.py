"""Motors that pull towards the places where their magnets meet the stator's teeth."""

import numpy as np
from rabbit_description.state import Array

from rabbit_sim.perturbation import Control, EngineNumber, Memory, Perturbation, setting

PERIODS = 60  # of a joint's turn


class Cogging(Perturbation):
    """A torque -c sin(PERIODS angle) on each joint."""

    order = 506

    cogging: EngineNumber = setting(0.0, 0, 100, "largest cogging torque of a joint, N m", Control("cogging", 1, "N m"))

    def transmitted(self, memory: Memory, torque: Array, joints: Array, rates: Array) -> Array:
        given: Array = torque - self.cogging * np.sin(PERIODS * joints)
        return given
