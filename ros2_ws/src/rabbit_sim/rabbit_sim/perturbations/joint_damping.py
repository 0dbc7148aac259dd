"""Viscous joints: -d M_jj(q) dq_j on actuated joint j, beside its motor.

So d alone would give the acceleration -d dq_j to a joint free to move, whatever its inertia.
"""

from rabbit_description.state import Array

from rabbit_sim.perturbation import JointTorque, Number, Perturbation, setting


class JointDamping(Perturbation):
    """See above."""

    order = 110

    joint_damping: Number = setting(0.0, 0, 100, "d in the joint torque -d M_jj dq_j, 1/s")

    def joint_torque(self, urdf: str) -> JointTorque:
        import pinocchio  # here alone: parameters are read without it

        model, d = pinocchio.buildModelFromXML(urdf), self.joint_damping
        data = model.createData()

        def torque(q: Array, dq: Array) -> Array:
            inertia: Array = pinocchio.crba(model, data, q).diagonal()[3:]
            return -d * inertia * dq[3:]

        return torque
