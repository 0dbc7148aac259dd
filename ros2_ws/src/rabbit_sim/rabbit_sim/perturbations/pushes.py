"""Pushes on the torso, forward first and then in turn."""

import numpy as np
from rabbit_description.state import TICK_SECONDS, Array

from rabbit_sim.perturbation import Control, EngineNumber, Memory, Number, Perturbation, setting
from rabbit_sim.plant import SUBSTEPS

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
        turn, since = divmod(tick, max(round(self.push_interval / TICK_SECONDS), 1))
        if not turn or since >= round(PUSH_SECONDS / TICK_SECONDS):
            return np.zeros(SUBSTEPS)
        force = self.push / PUSH_SECONDS
        return np.full(SUBSTEPS, force if turn % 2 else -force)
