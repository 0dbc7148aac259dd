"""Encoders whose zero moves."""

import numpy as np
from rabbit_description.state import TICK_SECONDS

from rabbit_sim.perturbation import Control, Measured, Number, Parameters, Perturbation, Sensor, setting
from rabbit_sim.plant import PlantReading


class EncoderDrift(Perturbation):
    """Each joint's at a constant rate of its own, which an episode draws."""

    order = 140

    encoder_drift: Number = setting(
        0.0, 0, 0.1, "std of the rate at which a joint's zero moves, rad/s", Control("encoders drift", 0.001, "rad/s")
    )

    def sensor(self) -> type[Sensor] | None:
        return DriftingEncoders if self.encoder_drift else None


class DriftingEncoders(Sensor):
    """See above; the rates are off by that rate."""

    def __init__(self, parameters: Parameters, rng: "np.random.Generator") -> None:
        super().__init__(parameters, rng)
        self._direction, self._offset = rng.standard_normal(4), np.zeros(4)

    def measure(self, measured: Measured, reading: PlantReading) -> Measured:
        angles, rates = measured.joints
        drift = self.parameters.encoder_drift * self._direction
        angles += self._offset
        rates += drift
        self._offset = self._offset + TICK_SECONDS * drift
        return measured
