"""Robots that walk side by side while a policy learns: when an episode ends, another robot takes its place."""

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np
from rabbit_benchmark.cells import Terrain
from rabbit_description.gait import load_gaits
from rabbit_description.robot_states import RobotStates
from rabbit_description.state import Array
from rabbit_experiments.assembly import make_simulation
from rabbit_sim.batch_simulation import BatchSimulation
from rabbit_sim.simulation import Outcome, Simulation
from rl_cbf_clf_controller.batch_controller import BatchController
from rl_cbf_clf_controller.batch_output import BatchScene
from rl_cbf_clf_controller.controller import Controller

from rabbit_residual.plants import described, draw_plant, ranges

STEPS = 10  # of an episode
AGAIN = 0.6  # probability that a plant on which an episode failed is walked once more
KNOWN = len(ranges()) + 2  # what `Rollout.known` has of a tick


@dataclass
class Rollout:
    """T + 1 ticks of N robots: what was read (T + 1, N, r), said (T + 1, N, m), and what came of it, (T + 1, N).

    `known` (T + 1, N, k): of the plant and the episode, which a value network reads too.

    `ended`: an episode, `failed`: and not well. The last tick serves as what follows the one before.
    """

    reads: Array
    known: Array
    said: Array
    reward: Array
    ended: Array
    failed: Array


@dataclass
class Command:
    """Of a tick: what the policy read and said, the torques (N, 4), and what they are worth beside steps and ends."""

    scene: BatchScene
    reads: Array
    said: Array
    torque: Array
    reward: Array


class Fleet(ABC):
    """`robots` robots on one terrain under copies of one `controller`; plants and episodes follow from `seed`."""

    failure: float  # reward of an episode's bad end

    def __init__(self, terrain: Terrain, robots: int, controller: Controller, seed: list[int]) -> None:
        self.terrain, self.ends = terrain, list[tuple[bool, int]]()
        self._gait, self._rng = load_gaits(controller.parameters.gait), np.random.default_rng(seed)
        self.controller = BatchController(controller, [controller.policy] * robots)
        episodes = [self._episode() for _ in range(robots)]
        self._batch = BatchSimulation([plant for plant, _ in episodes])
        self._batch.reset([seed for _, seed in episodes])
        for robot, (plant, episode) in enumerate(episodes):
            self.begin(robot, plant, episode)
        self._steps = np.zeros(robots, dtype=int)
        self._known = np.array([described(plant.parameters) for plant, _ in episodes])

    def begin(self, robot: int, plant: Simulation, episode: int) -> None:
        """An episode of this seed, in which the `robot` is this plant."""
        self.controller.reset(robot, episode)

    @abstractmethod
    def command(self, states: RobotStates) -> Command:
        """What the policy does in a tick."""

    @abstractmethod
    def step_reward(self, simulation: Simulation) -> float:
        """Of a step that has just been taken."""

    def walk(self, ticks: int) -> Rollout:
        """So many ticks and one more. `ends` then has how each episode ended: whether walked, and its steps."""
        self.ends = []
        rows = [self._tick() for _ in range(ticks + 1)]
        return Rollout(*(np.array(part) for part in zip(*rows, strict=True)))

    def _tick(self) -> tuple[Array, ...]:
        known = np.concatenate([self._known, self._steps[:, None] / STEPS], axis=1)
        command = self.command(self._batch.states)
        states, reward = self._batch.step(command.torque), command.reward
        for robot in (states.touchdowns > self._steps).nonzero()[0].tolist():
            reward[robot] += self.step_reward(self._batch.simulations[robot])
        self._steps = states.touchdowns.copy()
        ended, failed = ~states.running, np.zeros(len(states), dtype=bool)
        refused = {*command.scene.faults, *command.scene.errors}
        ended[list(refused)] = True
        for robot in ended.nonzero()[0].tolist():
            own = self._batch.simulations[robot]
            failed[robot] = robot in refused or own.outcome is not Outcome.WALKED
            self.ends.append((not failed[robot], int(states.touchdowns[robot])))
            if failed[robot] and self._rng.random() < AGAIN:
                plant, episode = own, int(self._rng.integers(2**32))
            else:
                own.close()
                plant, episode = self._episode()
            self._batch.restart(robot, plant, episode)
            self._known[robot] = described(plant.parameters)
            self.begin(robot, plant, episode)
            self._steps[robot] = 0
        reward[failed] += self.failure
        return command.reads, known, command.said, reward, ended, failed

    def _episode(self) -> tuple[Simulation, int]:
        seed = int(self._rng.integers(2**32))
        parameters = draw_plant(self.terrain, np.random.default_rng([seed, 1]), STEPS)
        return make_simulation(parameters, self._gait), seed
