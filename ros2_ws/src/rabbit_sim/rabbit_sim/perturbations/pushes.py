"""Pushes on the torso, forward first and then in turn."""

import numpy as np
from rabbit_description.state import Array
from rabbit_description.tick import ticks_in

from rabbit_sim.perturbation import Control, EngineNumber, Memory, Number, Perturbation, setting

PUSH_SECONDS = 0.1


class Pushes(Perturbation):
    """The first begins an interval after the reset."""

    switches = ("push",)

    push: EngineNumber = setting(
        0.0,
        0,
        100,
        "impulse on the torso in 100 ms, forward and backward in turn, N s",
        Control("pushes in turn", 1, "N s", at_reset=True),
    )
    push_interval: Number = setting(
        1.5,
        0.1,
        60,
        "time from the beginning of a push to the next, s",
        Control("a push each", 0.1, "s", at_reset=True),
    )

    def force(self, memory: Memory, tick: int) -> Array:
        seconds, substeps = memory.parameters.tick_seconds, memory.parameters.substeps
        turn, since = divmod(tick, ticks_in(self.push_interval, seconds))
        lasts = ticks_in(PUSH_SECONDS, seconds)
        if not turn or since >= lasts:
            return np.zeros(substeps)
        force = self.push / (lasts * seconds)
        return np.full(substeps, force if turn % 2 else -force)
