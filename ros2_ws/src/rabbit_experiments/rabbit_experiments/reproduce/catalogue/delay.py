"""Dead time of the motors, which the paper does not have."""

from rabbit_experiments.reproduce.tolerance import Tolerance


class Delay(Tolerance):
    """Beside the motors' lag."""

    name = "delay"
    title = "Delay of the torque, stepping stones"
    label = "further"
    paper = "nothing; it has a motor lag of 4 ms."
    field = "torque_delay"
    values = (0.0, 0.002, 0.004, 0.006, 0.008)
    axis = "delay of the torque (ms)"
    scale = 1e3
    what = "delay"
    caption = (
        "Courses of 20 stones walked over the delay; learned and oracle at scale 2, nominal at scale 1; 95% intervals."
    )
