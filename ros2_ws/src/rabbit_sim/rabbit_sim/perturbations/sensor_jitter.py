"""Measurements whose age varies."""

from typing import Self

import numpy as np
from pydantic import model_validator

from rabbit_sim.perturbation import Control, Measured, Parameters, Perturbation, Sensor, WholeSubsteps, setting
from rabbit_sim.plant import SUBSTEP_SECONDS, SUBSTEPS, PlantReading


class SensorJitter(Perturbation):
    """Each tick's age is drawn from 0 to the oldest in whole ms. A lab's sensors have `sensor_delay` instead."""

    order = 135

    sensor_jitter: WholeSubsteps = setting(
        0.0,
        0,
        0.02,
        "age of the oldest measurements, whole ms; each tick's is drawn, s",
        Control("age of measurements up to", 0.001, "s"),
    )

    def sensor(self) -> type[Sensor] | None:
        return LateSensors if self.sensor_jitter else None

    @model_validator(mode="after")
    def _lab_has_a_delay(self) -> Self:
        if self.sensor_jitter and getattr(self, "sensors", "exact") == "lab":
            raise ValueError(f"sensor_jitter = {self.sensor_jitter:g} with sensors lab: expected 0, or sensor_delay")
        return self


class LateSensors(Sensor):
    """See above."""

    needs_path = True

    def __init__(self, parameters: Parameters, rng: "np.random.Generator") -> None:
        super().__init__(parameters, rng)
        self._trace = np.zeros((0, 14))  # states of the last ticks, a substep apart

    def measure(self, measured: Measured, reading: PlantReading) -> Measured:
        oldest = round(self.parameters.sensor_jitter / SUBSTEP_SECONDS)
        path = reading.path if reading.path is not None else np.concatenate([measured.q, measured.dq])[None]
        self._trace = np.vstack([self._trace, path])[-oldest - SUBSTEPS :]
        age = min(int(self.rng.integers(oldest + 1)), len(self._trace) - 1)
        state = self._trace[-1 - age]
        return Measured(state[:7].copy(), state[7:].copy(), measured.foot_force)
