"""Measurements whose age varies."""

from typing import Self

import numpy as np
from pydantic import model_validator
from rabbit_description.state import DOF

from rabbit_sim.perturbation import Control, Measured, Memory, Perturbation, WholeSubsteps, setting
from rabbit_sim.plant import SUBSTEP_SECONDS, SUBSTEPS, PlantReading


class SensorJitter(Perturbation):
    """Each tick's age is drawn from 0 to the oldest in whole ms. A lab's sensors have `sensor_delay` instead."""

    order = 135
    needs_path = True

    sensor_jitter: WholeSubsteps = setting(
        0.0,
        0,
        0.02,
        "age of the oldest measurements, whole ms; each tick's is drawn, s",
        Control("age of measurements up to", 0.001, "s", at_reset=True),  # as `sensors`: with a lab's it is refused
    )

    @model_validator(mode="after")
    def _lab_has_a_delay(self) -> Self:
        if self.sensor_jitter and getattr(self, "sensors", "exact") == "lab":
            raise ValueError(f"sensor_jitter = {self.sensor_jitter:g} with sensors lab: expected 0, or sensor_delay")
        return self

    def begin(self, memory: Memory) -> None:
        memory.trace = np.zeros((0, 2 * DOF))  # states of the last ticks, a substep apart

    def measure(self, memory: Memory, measured: Measured, reading: PlantReading) -> Measured:
        oldest = round(self.sensor_jitter / SUBSTEP_SECONDS)
        path = reading.path if reading.path is not None else np.concatenate([measured.q, measured.dq])[None]
        memory.trace = np.vstack([memory.trace, path])[-oldest - SUBSTEPS :]
        age = min(int(memory.rng.integers(oldest + 1)), len(memory.trace) - 1)
        state = memory.trace[-1 - age]
        return Measured(state[:DOF].copy(), state[DOF:].copy(), measured.foot_force)
