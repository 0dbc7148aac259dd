"""What is measured of the truth: quantised angles, noisy rates and forces."""

import numpy as np
from rabbit_description.state import Array

from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.plant import PlantReading


class Sensors:
    """Encoders on pitch and the four joints, foot force sensors. The base's position and velocity are exact."""

    def __init__(self, parameters: SimulationParameters, rng: np.random.Generator) -> None:
        self._parameters = parameters
        self.rng = rng

    def measure(self, reading: PlantReading) -> tuple[Array, Array, Array]:
        """`q` (7,), `dq` (7,), `foot_force` (2, 2) as the controller gets them: new arrays."""
        q, dq, force = reading.q.copy(), reading.dq.copy(), reading.foot_force.copy()
        step = self._parameters.encoder_resolution
        if step > 0:
            q[2:] = step * np.round(q[2:] / step)
        if self._parameters.velocity_noise > 0:
            dq[2:] += self._parameters.velocity_noise * self.rng.standard_normal(5)
        if self._parameters.force_noise > 0:
            force += self._parameters.force_noise * self.rng.standard_normal((2, 2))
        return q, dq, force
