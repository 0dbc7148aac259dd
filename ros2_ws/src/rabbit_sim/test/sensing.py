"""A perturbation that measures, with its memory, as an episode begins it."""

from collections.abc import Callable
from functools import partial

import numpy as np
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.perturbation import Measured, Memory, Perturbation
from rabbit_sim.plant import PlantReading


def begun(
    kind: type[Perturbation], parameters: SimulationParameters, seed: int | None = None
) -> Callable[[Measured, PlantReading], Measured]:
    """Its `measure`; the generator is of this seed."""
    perturbation, memory = kind.of(parameters), Memory(rng=np.random.default_rng(seed), parameters=parameters)
    perturbation.begin(memory)
    return partial(perturbation.measure, memory)
