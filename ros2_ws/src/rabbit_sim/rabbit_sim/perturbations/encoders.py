"""What encoders and their drives make of the joints' angles and rates, be it of the state or of a lab's sensors."""

from math import exp

import numpy as np
from rabbit_description.state import JOINTS, RobotState
from rabbit_description.tick import ticks_in

from rabbit_sim.perturbation import Control, Memory, Number, Perturbation, setting
from rabbit_sim.plant import PlantReading

FREE_SECONDS = 1.0  # mean time until a joint's encoder sticks


class EncoderGain(Perturbation):
    """A joint's angle and rate come with a factor, which an episode draws for the joint."""

    order = 137

    encoder_gain_spread: Number = setting(
        0.0, 0, 0.5, "std of the factor on a joint's angle and rate", Control("encoders' gain", 0.005)
    )

    def begin(self, memory: Memory) -> None:
        memory.gain = 1 + self.encoder_gain_spread * memory.rng.standard_normal(JOINTS)

    def measure(self, memory: Memory, state: RobotState, reading: PlantReading) -> None:
        angles, rates = state.joints
        angles *= memory.gain
        rates *= memory.gain


class FilteredRates(Perturbation):
    """Rates through a low-pass filter, as those of a differentiated encoder.

    Of first order and time constant T: r <- r + (1 - exp(-h / T)) (rate - r), each tick h.
    """

    order = 138

    rate_lag: Number = setting(
        0.0, 0, 0.1, "time constant of the filter on the joints' rates, s", Control("rates' filter", 0.001, "s")
    )

    def begin(self, memory: Memory) -> None:
        memory.rates = None

    def measure(self, memory: Memory, state: RobotState, reading: PlantReading) -> None:
        _, rates = state.joints
        if memory.rates is not None:
            share = 1 - exp(-memory.parameters.tick_seconds / self.rate_lag)
            rates[:] = memory.rates + share * (rates - memory.rates)
        memory.rates = rates.copy()


class EncoderDrift(Perturbation):
    """The zero of each joint moves at a constant rate, which an episode draws; the joint's rate is off by that rate.

    In a tick in which a foot comes down it jumps as well, by another draw.
    """

    order = 140

    encoder_drift: Number = setting(
        0.0, 0, 0.1, "std of the rate at which a joint's zero moves, rad/s", Control("encoders drift", 0.001, "rad/s")
    )
    encoder_jump: Number = setting(
        0.0, 0, 0.1, "std by which a joint's zero jumps at a touchdown, rad", Control("encoders jump", 0.001, "rad")
    )

    def begin(self, memory: Memory) -> None:
        memory.direction, memory.offset = memory.rng.standard_normal(JOINTS), np.zeros(JOINTS)

    def measure(self, memory: Memory, state: RobotState, reading: PlantReading) -> None:
        angles, rates = state.joints
        for _ in reading.touches if self.encoder_jump else ():
            memory.offset = memory.offset + self.encoder_jump * memory.rng.standard_normal(JOINTS)
        drift = self.encoder_drift * memory.direction
        angles += memory.offset
        rates += drift
        memory.offset = memory.offset + memory.parameters.tick_seconds * drift


class StuckEncoders(Perturbation):
    """One encoder at a time sticks for a while: its angle stays, and its rate is zero.

    The joint is drawn at random. The time between two such faults is exponentially distributed.
    """

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

    def measure(self, memory: Memory, state: RobotState, reading: PlantReading) -> None:
        angles, rates = state.joints
        tick = memory.parameters.tick_seconds
        if not memory.ticks and memory.rng.random() < 1 - exp(-tick / FREE_SECONDS):
            memory.ticks = ticks_in(self.stuck_seconds, tick)
            memory.joint = int(memory.rng.integers(JOINTS))
            memory.angle = float(angles[memory.joint])
        if memory.ticks:
            memory.ticks -= 1
            angles[memory.joint], rates[memory.joint] = memory.angle, 0.0
