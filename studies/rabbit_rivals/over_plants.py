"""Walks of ten steps over the plants of the training, of which a value network also reads what no robot knows."""

from abc import abstractmethod
from collections.abc import Callable, Iterable

import numpy as np
from gymnasium.spaces import Box
from rabbit_benchmark.cells import Terrain
from rabbit_description.state import JOINTS, Array
from rabbit_experiments.vector_environment import Rows, WalkingEnv
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Landing
from rl_cbf_clf_controller.batch_controller import BatchController
from rl_cbf_clf_controller.controller import Controller

from rabbit_rivals.plants import described, draw_plant, ranges
from rabbit_rivals.vec_env import SideBySide

STEPS = 10  # of an episode
AGAIN = 0.6  # probability that a plant on which an episode failed is walked once more
KNOWN = len(ranges()) + 2  # numbers of the plant and the episode, which come after what the policy reads


class OverPlants(WalkingEnv):
    """`robots` robots on one terrain under copies of one `controller`; an episode fails unless the course is walked."""

    failure: float  # reward of an episode's bad end

    def __init__(self, terrain: Terrain, robots: int, reads: int, controller: Controller) -> None:
        self.terrain, self._described = terrain, np.zeros((robots, KNOWN - 1))
        spaces = Box(-np.inf, np.inf, (reads + KNOWN,), np.float32), Box(-1.0, 1.0, (JOINTS,), np.float32)
        batch = BatchController(controller, [controller.policy] * robots)
        super().__init__(batch, *spaces, robots, self.draw, AGAIN)

    @abstractmethod
    def read(self) -> Array:
        """What the policy reads (N, r) of `scene`."""

    @abstractmethod
    def command(self, actions: Array) -> tuple[Array, Array]:
        """The torques (N, 4) of actions (N, 4) within [-1, 1], and what they are worth beside steps and ends, (N,)."""

    @abstractmethod
    def step_reward(self, landing: Landing) -> float:
        """The reward of a step that was just taken."""

    def draw(self, seed: int) -> SimulationParameters:
        """The plant of an episode."""
        return draw_plant(self.terrain, np.random.default_rng([seed, 1]), STEPS)

    def begin_as(self, i: int, plant: SimulationParameters, seed: int) -> None:
        """See `WalkingEnv`."""
        super().begin_as(i, plant, seed)
        self._described[i] = described(plant)

    def look(self) -> Rows:
        """See `EpisodesEnv`."""
        self.scene = self.controller.look(self.states)
        parts = self.read(), self._described, self.states.touchdowns[:, None] / STEPS
        return np.nan_to_num(np.concatenate(parts, axis=1))

    def act(self, actions: Array) -> tuple[Array, Iterable[int]]:
        """See `WalkingEnv`."""
        torque, self._reward = self.command(actions.clip(-1, 1))
        return torque, {*self.scene.faults, *self.scene.errors}

    def score(self) -> tuple[Array, Rows]:
        """See `EpisodesEnv`."""
        reward, failed = self._reward, self.tick.ended & ~self.tick.walked
        for i, landing in self.tick.landings.items():
            reward[i] += self.step_reward(landing)
        reward[failed] += self.failure
        return reward, failed


def over_plants(kind: Callable[[Terrain, int], OverPlants], robots: int, flat: float) -> SideBySide:
    """So many robots, of which a share walks on `flat` ground."""
    shares: dict[Terrain, int] = {"stones": robots - round(robots * flat), "flat": round(robots * flat)}
    return SideBySide([kind(terrain, share) for terrain, share in shares.items() if share])
