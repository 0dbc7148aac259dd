"""A plant that is another robot in each episode, for `vector_environment`."""

import math

import numpy as np
from rabbit_sim.parameters import SimulationParameters

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
