"""Joints with friction, damping and springs, beside their motors."""

import numpy as np
from rabbit_description.planar_urdf import BASE
from rabbit_description.state import Array

from rabbit_sim.perturbation import Control, EngineNumber, JointTorque, Number, Perturbation, setting

KNEES = np.array([0.0, 1.0, 0.0, 1.0])  # of the four joints


class DryFriction(Perturbation):
    """Coulomb friction and stiction, which each engine has: read by its plant.

    At rest a joint takes up to so much; sliding it has so much against the motion.
    """

    coulomb: EngineNumber = setting(
        0.0, 0, 100, "dry friction of each joint, with stiction, N m", Control("dry friction", 0.5, "N m")
    )


class JointDamping(Perturbation):
    """Viscous joints: -d M_jj(q) dq_j on actuated joint j.

    So d alone would give the acceleration -d dq_j to a joint free to move, whatever its inertia.
    """

    order = 110

    joint_damping: Number = setting(0.0, 0, 100, "d in the joint torque -d M_jj dq_j, 1/s")

    def joint_torque(self, urdf: str) -> JointTorque:
        import pinocchio  # here alone: parameters are read without it

        model, d = pinocchio.buildModelFromXML(urdf), self.joint_damping
        data = model.createData()

        def torque(q: Array, dq: Array) -> Array:
            inertia: Array = pinocchio.crba(model, data, q).diagonal()[BASE:]
            return -d * inertia * dq[BASE:]

        return torque


class KneeSpring(Perturbation):
    """Springs, k (rest - angle)."""

    order = 100
    switches = ("knee_spring",)

    knee_spring: EngineNumber = setting(
        0.0,
        0,
        1000,
        "stiffness of springs beside the knees' motors, N m/rad",
        Control("knees' springs", 10, "N m/rad", high=200),
    )
    knee_rest: Number = setting(0.4, -1, 2, "angle at which the knees' springs are at rest, rad")

    def joint_torque(self, urdf: str) -> JointTorque:
        stiffness, rest = self.knee_spring * KNEES, self.knee_rest
        return lambda q, dq: stiffness * (rest - q[BASE:])
