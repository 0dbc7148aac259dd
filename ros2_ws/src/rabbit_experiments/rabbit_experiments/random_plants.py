"""A plant that is another robot in each episode: what a policy beside the identification is trained on."""

import math

import numpy as np
from rabbit_description.gait import Gaits
from rabbit_description.state import Array, RobotState
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Simulation

from rabbit_experiments.assembly import make_simulation

SCALES = (0.5, 3.0)
PAYLOAD = 72.0  # kg
LOSS, DAMPING, BEND = 0.15, 1.0, 0.05


def random_plant(parameters: SimulationParameters, seed: int) -> SimulationParameters:
    """`parameters` with a mass scale or a payload, and a power loss, a damping and a bend, each as likely as not."""
    rng = np.random.default_rng([seed, 1])
    if rng.random() < 0.5:
        masses = {"mass_scale": math.exp(rng.uniform(*np.log(SCALES))), "payload": 0.0}
    else:
        masses = {"mass_scale": 1.0, "payload": rng.uniform(0.0, PAYLOAD)}
    others = {
        "motor_loss": rng.uniform(0, LOSS),
        "joint_damping": rng.uniform(0, DAMPING),
        "link_bend": rng.uniform(-BEND, BEND),
    }
    return parameters.model_copy(update=masses | {name: value for name, value in others.items() if rng.random() < 0.5})


class RandomPlants:
    """A `Simulation` of another robot from each reset on; the seed decides which."""

    def __init__(self, parameters: SimulationParameters, gait: Gaits) -> None:
        self._parameters, self._gait = parameters, gait
        self._simulation: Simulation | None = None

    def reset(self, seed: int) -> RobotState:
        """Begin an episode."""
        self.close()
        self._simulation = make_simulation(random_plant(self._parameters, seed), self._gait)
        return self._simulation.reset(seed)

    def step(self, torque: Array) -> RobotState:
        """Advance one tick; raises `RuntimeError` before the first reset."""
        if self._simulation is None:
            raise RuntimeError("random plants: expected a reset before the first step")
        return self._simulation.step(torque)

    def close(self) -> None:
        """End the present robot."""
        if self._simulation:
            self._simulation.close()
