"""Encoders that count too much or too little."""

from rabbit_description.state import JOINTS

from rabbit_sim.perturbation import Control, Measured, Memory, Number, Perturbation, setting
from rabbit_sim.plant import PlantReading


class EncoderGain(Perturbation):
    """Each joint's angle and rate come with a factor of its own, which an episode draws."""

    order = 137

    encoder_gain_spread: Number = setting(
        0.0, 0, 0.5, "std of the factor on a joint's angle and rate", Control("encoders' gain", 0.005)
    )

    def begin(self, memory: Memory) -> None:
        memory.gain = 1 + self.encoder_gain_spread * memory.rng.standard_normal(JOINTS)

    def measure(self, memory: Memory, measured: Measured, reading: PlantReading) -> Measured:
        angles, rates = measured.joints
        angles *= memory.gain
        rates *= memory.gain
        return measured
