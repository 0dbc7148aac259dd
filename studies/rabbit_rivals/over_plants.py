"""Walks of ten steps over the plants of the training, of which a value network also reads what no robot knows."""

from abc import abstractmethod
from collections.abc import Callable, Iterable
from functools import partial

import numpy as np
from gymnasium.spaces import Box
from rabbit_benchmark.cells import Terrain
from rabbit_description.robot_states import RobotStates
from rabbit_description.state import JOINTS, Array
from rabbit_experiments.vector_environment import Formulation, Rows, Tick, WalkingEnv
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Landing, Simulation
from rl_cbf_clf_controller.batch_controller import BatchController
from rl_cbf_clf_controller.controller import Controller

from rabbit_rivals.plants import described, draw_plant, ranges
from rabbit_rivals.vec_env import SideBySide

STEPS = 10  # of an episode
AGAIN = 0.6  # probability that a plant on which an episode failed is walked once more
KNOWN = len(ranges()) + 2  # numbers of the plant and the episode, which come after what the policy reads


class OverPlants(Formulation):
    """`robots` robots on one terrain under copies of one `controller`; an episode that is not walked to its end fails."""

    failure: float  # reward of an episode's bad end

    def __init__(self, terrain: Terrain, robots: int, reads: int, controller: Controller) -> None:
        self.terrain, self.controller = terrain, BatchController(controller, [controller.policy] * robots)
        self.observations = Box(-np.inf, np.inf, (reads + KNOWN,), np.float32)
        self.actions = Box(-1.0, 1.0, (JOINTS,), np.float32)
        self._described = np.zeros((robots, KNOWN - 1))

    @abstractmethod
    def read(self, states: RobotStates) -> Array:
        """What the policy reads (N, r) of `scene`."""

    @abstractmethod
    def command(self, actions: Array) -> tuple[Array, Array]:
        """The torques (N, 4) of actions (N, 4) within [-1, 1], and what they are worth beside steps and ends, (N,)."""

    @abstractmethod
    def step_reward(self, landing: Landing) -> float:
        """Of a step that was just taken."""

    def begin(self, i: int, simulation: Simulation, seed: int) -> None:
        """See `Formulation`."""
        super().begin(i, simulation, seed)
        self._described[i] = described(simulation.parameters)

    def look(self, states: RobotStates) -> Array:
        """See `Formulation`."""
        self.scene = self.controller.look(states)
        parts = self.read(states), self._described, states.touchdowns[:, None] / STEPS
        return np.nan_to_num(np.concatenate(parts, axis=1))

    def act(self, actions: Array) -> tuple[Array, Iterable[int]]:
        """See `Formulation`."""
        torque, self._reward = self.command(actions.clip(-1, 1))
        return torque, {*self.scene.faults, *self.scene.errors}

    def score(self, tick: Tick) -> tuple[Array, Rows]:
        """See `Formulation`."""
        reward, failed = self._reward, tick.ended & ~tick.walked
        for i, landing in tick.landings.items():
            reward[i] += self.step_reward(landing)
        reward[failed] += self.failure
        return reward, failed


def over_plants(formulation: Callable[[Terrain, int], OverPlants], robots: int, flat: float) -> SideBySide:
    """So many robots, of which a share walks on `flat` ground."""
    shares: dict[Terrain, int] = {"stones": robots - round(robots * flat), "flat": round(robots * flat)}
    return SideBySide(
        [
            WalkingEnv(formulation(terrain, share), share, partial(_plant, terrain), AGAIN)
            for terrain, share in shares.items()
            if share
        ]
    )


def _plant(terrain: Terrain, seed: int) -> SimulationParameters:
    return draw_plant(terrain, np.random.default_rng([seed, 1]), STEPS)
