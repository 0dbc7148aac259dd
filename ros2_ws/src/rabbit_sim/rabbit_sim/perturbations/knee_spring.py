"""Springs beside the knees' motors."""

import numpy as np

from rabbit_sim.perturbation import Control, EngineNumber, JointTorque, Number, Perturbation, setting

KNEES = np.array([0.0, 1.0, 0.0, 1.0])  # of the four joints


class KneeSpring(Perturbation):
    """k (rest - angle)."""

    order = 100

    knee_spring: EngineNumber = setting(
        0.0, 0, 1000, "beside the knees' motors, N m/rad", Control("knees' springs", 10, "N m/rad", high=200)
    )
    knee_rest: Number = setting(0.4, -1, 2, "where the knees' springs are at rest, rad")

    def joint_torque(self, urdf: str) -> JointTorque | None:
        stiffness, rest = self.knee_spring * KNEES, self.knee_rest
        return (lambda q, dq: stiffness * (rest - q[3:])) if self.knee_spring else None
