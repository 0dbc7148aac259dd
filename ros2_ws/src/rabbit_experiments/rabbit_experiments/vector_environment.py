"""RABBITs in MuJoCo as a vectorised Gymnasium environment, if wanted another robot in each episode.

env = make_vector_environment(TrainingParameters(), load_parameters("ours", controller="rl-cbf-clf-qp"),
                              SimulationParameters(plant="mujoco", sensors="lab"), robots=64, draw=random_plant)
"""

from collections.abc import Callable
from typing import Any

from rabbit_description.gait import load_gaits
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.batch_controller import BatchController
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_trainer.parameters import TrainingParameters
from rl_trainer.vector_environment import VectorWalkingEnv

from rabbit_experiments.assembly import make_simulation

Draw = Callable[[SimulationParameters, int], SimulationParameters]


def make_vector_environment(
    parameters: TrainingParameters,
    controller: ControllerParameters,
    plant: SimulationParameters,
    robots: int,
    draw: Draw = lambda plant, seed: plant,
) -> VectorWalkingEnv:
    """`draw`: the plant of an episode from its seed, such as `random_plants.random_plant`.

    Raises:
        ValueError: no robot, another plant than MuJoCo's, or a controller with an adaptation.
    """
    from rabbit_sim.batch_simulation import BatchSimulation

    if robots < 1:
        raise ValueError(f"robots = {robots}: expected at least 1")
    gait = load_gaits(controller.gait)
    policy = ZeroPolicy(controller.problem)  # the actions take its place
    own = controller.model_copy(update={"sigma": parameters.sigma})
    batch = BatchController(Controller(own, gait, policy), [policy] * robots, details=True)

    def make_plant(seed: int) -> Any:
        return make_simulation(draw(plant, seed), gait)

    BatchSimulation([make_plant(0)])  # complains here of a plant that cannot be in a batch
    return VectorWalkingEnv(parameters, batch, make_plant, BatchSimulation)
