"""Encoders that stick for a while: the angle stays, and the rate is zero."""

from math import exp

from rabbit_description.state import JOINTS, TICK_SECONDS

from rabbit_sim.perturbation import Control, Measured, Memory, Number, Perturbation, setting
from rabbit_sim.plant import PlantReading

FREE_SECONDS = 1.0  # mean time until a joint's encoder sticks


class StuckEncoders(Perturbation):
    """One encoder sticks at a time. Which one is drawn anew; the time until it sticks is exponentially distributed."""

    order = 145

    stuck_seconds: Number = setting(
        0.0,
        0,
        1,
        "time for which a joint's encoder sticks, about once a second, s; 0: never",
        Control("encoder sticks", 0.01, "s"),
    )

    def begin(self, memory: Memory) -> None:
        memory.ticks, memory.joint, memory.angle = 0, 0, 0.0

    def measure(self, memory: Memory, measured: Measured, reading: PlantReading) -> Measured:
        angles, rates = measured.joints
        if not memory.ticks and memory.rng.random() < 1 - exp(-TICK_SECONDS / FREE_SECONDS):
            memory.ticks = max(round(self.stuck_seconds / TICK_SECONDS), 1)
            memory.joint = int(memory.rng.integers(JOINTS))
            memory.angle = float(angles[memory.joint])
        if memory.ticks:
            memory.ticks -= 1
            angles[memory.joint], rates[memory.joint] = memory.angle, 0.0
        return measured
