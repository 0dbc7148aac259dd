"""RABBITs in MuJoCo as a vectorised Gymnasium environment, if wanted another robot in each episode.

env = make_vector_environment(TrainingParameters(), load_parameters("ours", controller="rl-cbf-clf-qp"),
                              SimulationParameters(plant="mujoco", sensors="lab"), robots=64, draw=random_plant)
"""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
from rabbit_description.gait import load_gaits
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.batch_controller import BatchController
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_trainer.parameters import TrainingParameters
from rl_trainer.vector_environment import VectorWalkingEnv

from rabbit_experiments.assembly import make_simulation

SCALES = (0.5, 3.0)
PAYLOAD = 72.0  # kg
LOSS, DAMPING, BEND = 0.15, 1.0, 0.05

Draw = Callable[[SimulationParameters, int], SimulationParameters]


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


def make_vector_environment(
    parameters: TrainingParameters,
    controller: ControllerParameters,
    plant: SimulationParameters,
    robots: int,
    draw: Draw = lambda plant, seed: plant,
) -> VectorWalkingEnv:
    """`draw`: the plant of an episode from its seed, such as `random_plant`.

    Raises:
        ValueError: no robot, another plant than MuJoCo's, or a controller with an adaptation.
    """
    from rabbit_sim.batch_simulation import BatchSimulation  # needs MuJoCo, which not everybody has

    if robots < 1:
        raise ValueError(f"robots = {robots}: expected at least 1")
    if plant.plant != "mujoco":
        raise ValueError(f"plant = {plant.plant}: expected mujoco")
    gait = load_gaits(controller.gait)
    policy = ZeroPolicy(controller.problem)  # the actions take its place
    own = controller.model_copy(update={"sigma": parameters.sigma})
    batch = BatchController(Controller(own, gait, policy), [policy] * robots, details=True)

    def make_plant(seed: int) -> Any:
        return make_simulation(draw(plant, seed), gait)

    return VectorWalkingEnv(parameters, batch, make_plant, BatchSimulation)
