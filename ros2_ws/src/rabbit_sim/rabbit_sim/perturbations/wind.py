"""Wind: a horizontal force on the torso, steady and in gusts.

A gust is a first-order Gauss-Markov process g, as Dryden's model has it for the wind along the way: with the standard
deviation s, the time constant T and a tick h,   g(t + h) = a g(t) + s sqrt(1 - a^2) n,  a = exp(-h / T),  n ~ N(0, 1)
"""

from math import exp, sqrt

import numpy as np
from rabbit_description.state import Array

from rabbit_sim.perturbation import Control, EngineNumber, Memory, Number, Perturbation, setting


class Wind(Perturbation):
    """See above; positive from behind."""

    switches = ("wind", "gusts")

    wind: EngineNumber = setting(0.0, -200, 200, "steady force on the torso, N", Control("wind", 5, "N"))
    gusts: EngineNumber = setting(0.0, 0, 200, "std of gusts about the steady force, N", Control("gusts", 5, "N"))
    gust_seconds: Number = setting(0.5, 0.01, 60, "time constant of the gusts, s")

    def begin(self, memory: Memory) -> None:
        memory.gust = self.gusts * memory.rng.standard_normal()

    def force(self, memory: Memory, tick: int) -> Array:
        force = np.full(memory.parameters.substeps, self.wind + memory.gust)
        keeps = exp(-memory.parameters.tick_seconds / self.gust_seconds)
        memory.gust = keeps * memory.gust + self.gusts * sqrt(1 - keeps**2) * memory.rng.standard_normal()
        return force
