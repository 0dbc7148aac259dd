"""Encoders whose zero moves."""

import numpy as np
from rabbit_description.state import JOINTS, TICK_SECONDS

from rabbit_sim.perturbation import Control, Measured, Memory, Number, Perturbation, setting
from rabbit_sim.plant import PlantReading


class EncoderDrift(Perturbation):
    """Each joint's at a constant rate of its own, which an episode draws; the rates are off by that rate."""

    order = 140

    encoder_drift: Number = setting(
        0.0, 0, 0.1, "std of the rate at which a joint's zero moves, rad/s", Control("encoders drift", 0.001, "rad/s")
    )

    def begin(self, memory: Memory) -> None:
        memory.direction, memory.offset = memory.rng.standard_normal(JOINTS), np.zeros(JOINTS)

    def measure(self, memory: Memory, measured: Measured, reading: PlantReading) -> Measured:
        angles, rates = measured.joints
        drift = self.encoder_drift * memory.direction
        angles += memory.offset
        rates += drift
        memory.offset = memory.offset + TICK_SECONDS * drift
        return measured
