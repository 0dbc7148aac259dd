"""RABBIT for `gymnasium`, by name: once this module is imported, which its full name does.

    gymnasium.make_vec("rabbit_experiments.registered:Rabbit-v0", num_envs=64, mass_scale=2.0)
    gymnasium.make("rabbit_experiments.registered:Rabbit-v0")

Both are `VectorWalkingEnv` with the paper's reward. Further arguments are parameters of the plant, see
`SimulationParameters`: MuJoCo's, twice the mass, unless they say otherwise.
"""

from typing import Any

import gymnasium
import numpy as np
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_trainer.parameters import TrainingParameters

from rabbit_experiments.conditions import TRAINING_SCALE
from rabbit_experiments.vector_environment import Rows, VectorWalkingEnv

NAME = "Rabbit-v0"


def make_vector(num_envs: int = 1, **plant: Any) -> VectorWalkingEnv:
    """So many robots; raises `ValidationError` for what is no parameter of the plant, ValueError for another engine."""
    parameters = SimulationParameters.model_validate({"plant": "mujoco", "mass_scale": TRAINING_SCALE, **plant})
    controller = ControllerParameters(controller="rl-cbf-clf-qp")
    return VectorWalkingEnv(TrainingParameters(), controller, parameters, num_envs)


class OneRobot(gymnasium.Env[Rows, Rows]):
    """The vector environment of one robot, whose next episode begins at a reset."""

    def __init__(self, **plant: Any) -> None:
        """Raises as `make_vector`."""
        self._robots = make_vector(1, **plant)
        self.observation_space = self._robots.single_observation_space
        self.action_space = self._robots.single_action_space

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Rows, dict[str, Any]]:
        """An episode begins, of this `seed` where there is one."""
        super().reset(seed=seed)
        return self._robots.reset(seed=seed)[0][0], {}

    def step(self, action: Rows) -> tuple[Rows, float, bool, bool, dict[str, Any]]:
        """One tick."""
        observed, rewards, failed, cut, infos = self._robots.step(np.asarray(action)[None])
        last = infos.get("final_obs", observed)
        return last[0], float(rewards[0]), bool(failed[0]), bool(cut[0]), {}


gymnasium.register(NAME, entry_point=OneRobot, vector_entry_point=make_vector)
