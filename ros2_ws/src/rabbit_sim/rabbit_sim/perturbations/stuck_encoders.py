"""Encoders that stick for a while: the angle stays, and the rate is zero."""

from math import exp

import numpy as np
from rabbit_description.state import TICK_SECONDS

from rabbit_sim.perturbation import Control, Measured, Number, Parameters, Perturbation, Sensor, setting
from rabbit_sim.plant import PlantReading

FREE_SECONDS = 1.0  # mean time until a joint's encoder sticks


class StuckEncoders(Perturbation):
    """One encoder sticks at a time. Which one is drawn anew; the time until it sticks is exponentially distributed."""

    order = 145

    stuck_seconds: Number = setting(
        0.0,
        0,
        1,
        "for which a joint's encoder sticks, about once a second, s; 0: never",
        Control("encoder sticks", 0.01, "s"),
    )

    def sensor(self) -> type[Sensor] | None:
        return StickingEncoders if self.stuck_seconds else None


class StickingEncoders(Sensor):
    """See above."""

    def __init__(self, parameters: Parameters, rng: "np.random.Generator") -> None:
        super().__init__(parameters, rng)
        self._ticks, self._joint, self._angle = 0, 0, 0.0

    def measure(self, measured: Measured, reading: PlantReading) -> Measured:
        angles, rates = measured.joints
        if not self._ticks and self.rng.random() < 1 - exp(-TICK_SECONDS / FREE_SECONDS):
            self._ticks = max(round(self.parameters.stuck_seconds / TICK_SECONDS), 1)
            self._joint = int(self.rng.integers(4))
            self._angle = float(angles[self._joint])
        if self._ticks:
            self._ticks -= 1
            angles[self._joint], rates[self._joint] = self._angle, 0.0
        return measured
