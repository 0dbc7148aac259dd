"""The motors: what perturbations make of commanded torques over each tick's substeps, for one robot or N at once."""

from collections.abc import Sequence

import numpy as np
from rabbit_description.state import JOINTS, Array

from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.perturbations import KINDS


class Actuation:
    """The four motors of a robot, or of N with ticks of one length.

    `states`: what each kind of perturbation remembers, (N, remembered, 4).
    """

    def __init__(self, *parameters: SimulationParameters) -> None:
        self._substeps = parameters[0].substeps
        kinds = [kind for kind in KINDS if kind.has("drive")]
        self._stages = [kind.of_all(parameters) for kind in kinds if any(map(kind.is_in_force, parameters))]
        self.states = {type(stage): np.zeros((len(parameters), stage.remembered(), JOINTS)) for stage in self._stages}

    def rest(self, robot: int | slice = slice(None)) -> None:
        """Brings the motors of one robot, or of all, to rest, no command on its way."""
        for state in self.states.values():
            state[robot] = 0.0

    def going_on(self, robots: Array, parameters: Sequence[SimulationParameters]) -> "Actuation":
        """The motors of some robots, by number, with these parameters, as they are now."""
        motors = Actuation(*parameters)
        for kind in self.states.keys() & motors.states.keys():
            old, new = self.states[kind], motors.states[kind]
            known = min(old.shape[1], new.shape[1])
            new[:, :known] = old[robots, :known]
        return motors

    def advance(self, command: Array) -> Array:
        """Torques held over the substeps of one tick, N m: (substeps, 4) for a command (4,), (N, substeps, 4) for N."""
        torques = command.reshape(-1, 1, JOINTS).repeat(self._substeps, axis=1)
        for stage in self._stages:
            torques = stage.drive(torques, self.states[type(stage)])
        return torques.reshape(*command.shape[:-1], self._substeps, JOINTS)
