"""A perturbation that measures, with its memory, as an episode begins it."""

from collections.abc import Callable

import numpy as np
from rabbit_description.state import Array, RobotState
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.perturbation import Memory, Perturbation
from rabbit_sim.plant import PlantReading


def state_of(q: Array, dq: Array, foot_force: Array) -> RobotState:
    """A state of these numbers, before anything measures."""
    return RobotState(0, q, dq, foot_force, np.zeros(2, dtype=bool), 0, None)


def begun(
    kind: type[Perturbation], parameters: SimulationParameters, seed: int | None = None
) -> Callable[[RobotState, PlantReading], RobotState]:
    """What its `measure` makes of a state; the generator is of this seed."""
    perturbation, memory = kind.of(parameters), Memory(rng=np.random.default_rng(seed), parameters=parameters)
    perturbation.begin(memory)

    def measured(state: RobotState, reading: PlantReading) -> RobotState:
        perturbation.measure(memory, state, reading)
        return state

    return measured
