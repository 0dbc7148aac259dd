"""Motors that give less the faster they turn, as a direct-current motor at its voltage's limit does."""

import numpy as np
from rabbit_description.state import TORQUE_LIMIT, Array

from rabbit_sim.perturbation import Control, EngineNumber, Memory, Perturbation, setting


class FadingMotors(Perturbation):
    """At the rate w a torque along the motion is at most TORQUE_LIMIT (1 - |w| / no_load_speed)."""

    order = 505

    no_load_speed: EngineNumber = setting(
        0.0,
        0,
        1000,
        "rate at which a motor gives no torque along its motion, rad/s; 0: none",
        Control("no-load speed, 0: none", 1, "rad/s"),
    )

    def transmitted(self, memory: Memory, torque: Array, joints: Array, rates: Array) -> Array:
        most = TORQUE_LIMIT * np.maximum(1 - np.abs(rates) / self.no_load_speed, 0)
        given: Array = np.where(torque * rates > 0, torque.clip(-most, most), torque)
        return given
