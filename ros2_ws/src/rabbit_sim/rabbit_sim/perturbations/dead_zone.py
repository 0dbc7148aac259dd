"""Motors that do nothing until enough is asked."""

import numpy as np
from rabbit_description.state import Array

from rabbit_sim.perturbation import Control, Number, Perturbation, setting


class DeadZone(Perturbation):
    """u - d sign(u) where |u| > d, else 0."""

    order = 55

    dead_zone: Number = setting(
        0.0,
        0,
        100,
        "torque below which a motor gives nothing, and which it always lacks, N m",
        Control("dead zone", 1, "N m"),
    )

    def drive(self, torques: Array, state: Array) -> Array:
        given: Array = torques - np.clip(torques, -self.dead_zone, self.dead_zone)
        return given
