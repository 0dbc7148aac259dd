"""Motors that lose 15% of their power to friction (Discussion)."""

from rabbit_experiments.reproduce.perturbation import Perturbation


class MotorPower(Perturbation):
    """Every torque is 15% less than commanded."""

    name = "motor-power"
    title = "Motor power -15%"
    paper = "Joint friction as a loss of 15% of motor power: successful results."
    why = (
        "At scale 1 a loss of 15% does not stop the nominal controllers. The policies, trained at scale 2, err by "
        "half the mass there besides: over stones they leave the cone and the stones in PyBullet; on `rigid`, "
        "whose stance foot is pinned, they walk."
    )
    field = "motor_loss"
    value = 0.15
    what = "15% less power"
