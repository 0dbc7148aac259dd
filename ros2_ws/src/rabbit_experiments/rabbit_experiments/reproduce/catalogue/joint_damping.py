"""Damped joints (Discussion)."""

from rabbit_experiments.reproduce.perturbation import Perturbation


class JointDamping(Perturbation):
    """A coefficient of 1 (rad/s^2)/(rad/s), the paper's largest."""

    name = "joint-damping"
    title = "Joint damping 1 (rad/s²)/(rad/s)"
    paper = "Joint damping of up to 1 (rad/s²)/(rad/s): successful results."
    why = (
        "Damping alone does not stop the nominal controller on flat ground. At scale 1 the policies, trained at "
        "scale 2, err by half the mass besides: in PyBullet their stance foot leaves the ground, on `rigid`, "
        "where it is pinned, it cannot."
    )
    field = "joint_damping"
    value = 1.0
    what = "joints damped by 1/s"
