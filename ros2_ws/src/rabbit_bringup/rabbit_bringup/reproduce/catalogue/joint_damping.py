"""Damped joints (Discussion)."""

from rabbit_bringup.reproduce.perturbation import Perturbation


class JointDamping(Perturbation):
    """A coefficient of 1 (rad/s^2)/(rad/s), the paper's largest."""

    name = "joint-damping"
    title = "Joint damping 1 (rad/s²)/(rad/s)"
    paper = "Joint damping of up to 1 (rad/s²)/(rad/s): successful results."
    field = "joint_damping"
    value = 1.0
    what = "joints damped by 1/s"
