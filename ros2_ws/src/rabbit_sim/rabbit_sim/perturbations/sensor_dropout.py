"""Measurements that are lost on their way."""

import numpy as np

from rabbit_sim.perturbation import Control, Measured, Number, Parameters, Perturbation, Sensor, setting
from rabbit_sim.plant import PlantReading


class SensorDropout(Perturbation):
    """Each tick's is lost or not, whatever became of the last; the last one that came is repeated."""

    order = 150

    sensor_dropout: Number = setting(
        0.0, 0, 0.9, "probability that a tick's measurement is lost", Control("lost measurements", 0.01)
    )

    def sensor(self) -> type[Sensor] | None:
        return LossySensors if self.sensor_dropout else None


class LossySensors(Sensor):
    """See above; an episode's first measurement always comes."""

    def __init__(self, parameters: Parameters, rng: "np.random.Generator") -> None:
        super().__init__(parameters, rng)
        self._last: Measured | None = None

    def measure(self, measured: Measured, reading: PlantReading) -> Measured:
        if self._last is None or self.rng.random() >= self.parameters.sensor_dropout:
            self._last = measured
        return self._last.copy()
