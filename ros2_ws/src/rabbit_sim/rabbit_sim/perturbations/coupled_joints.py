"""Legs in which the hip's motor also pulls at the knee, as over a belt."""

import numpy as np
from rabbit_description.state import Array

from rabbit_sim.perturbation import Control, EngineNumber, Memory, Perturbation, setting

HIPS, KNEES = [0, 2], [1, 3]  # of the joints


class CoupledJoints(Perturbation):
    """The knee gets a share of its hip's torque too."""

    order = 504

    joint_coupling: EngineNumber = setting(
        0.0, -1, 1, "share of a hip's torque that its knee gets too", Control("hip pulls at knee", 0.05)
    )

    def transmitted(self, memory: Memory, torque: Array, joints: Array, rates: Array) -> Array:
        given: Array = np.array(torque)
        given[KNEES] += self.joint_coupling * torque[HIPS]
        return given
