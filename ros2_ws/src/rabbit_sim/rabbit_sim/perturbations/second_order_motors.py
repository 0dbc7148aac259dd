"""Motors whose torque swings towards what is asked, as a current loop's does:  tau'' = w^2 (u - tau) - 2 z w tau'."""

from functools import cached_property, lru_cache
from math import pi

import numpy as np
from rabbit_description.state import Array

from rabbit_sim.perturbation import Control, Number, Perturbation, setting
from rabbit_sim.plant import SUBSTEP_SECONDS, SUBSTEPS


class SecondOrderMotors(Perturbation):
    """See above, solved exactly over each substep, in which u is constant. The state is tau and tau'."""

    order = 75

    motor_frequency: Number = setting(
        0.0,
        0,
        500,
        "natural frequency of second-order motors, Hz; 0: none",
        Control("motors' frequency, 0: any", 1, "Hz"),
    )
    motor_damping: Number = setting(0.7, 0.05, 5, "damping ratio z of second-order motors")

    @cached_property
    def _steps(self) -> tuple[Array, Array]:
        """Of N robots: (tau, tau') at a substep's end from those at its start (N, 2, 2), and from u (N, 2, 1)."""
        pairs = [
            of_motor(*pair) for pair in zip(np.ravel(self.motor_frequency), np.ravel(self.motor_damping), strict=True)
        ]
        from_state, from_drive = map(np.array, zip(*pairs, strict=True))
        return from_state, from_drive

    def remembered(self) -> int:
        return 2

    def drive(self, torques: Array, state: Array) -> Array:
        from_state, from_drive = self._steps
        acts = np.asarray(self.motor_frequency)[:, 0] > 0
        for substep in range(SUBSTEPS):
            wanted, start = torques[:, substep].copy(), state[:, 0].copy()
            state[:] = from_state @ state + from_drive * wanted[:, None]
            torques[:, substep] = np.where(acts, (start + state[:, 0]) / 2, wanted)
        return torques


@lru_cache(maxsize=4096)  # a batch asks for all its robots again when one begins an episode
def of_motor(frequency: float, damping: float) -> tuple[Array, Array]:
    """One motor's step: what of its state (2, 2) and of the torque that is asked (2, 1) is there at the end."""
    from scipy.linalg import expm  # slow to import

    w = 2 * pi * frequency
    matrix = np.array([[0.0, 1.0, 0.0], [-(w**2), -2 * damping * w, w**2], [0.0, 0.0, 0.0]])
    step = expm(matrix * SUBSTEP_SECONDS)
    return step[:2, :2], step[:2, 2:]
