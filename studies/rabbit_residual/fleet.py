"""Robots that walk side by side while a policy learns: when an episode ends, another robot takes its place."""

from collections.abc import Callable

import numpy as np
from rabbit_benchmark.cells import Terrain
from rabbit_description.gait import load_gaits
from rabbit_description.state import Array
from rabbit_experiments.assembly import make_simulation
from rabbit_sim.batch_simulation import BatchSimulation
from rabbit_sim.simulation import Outcome, Simulation
from rl_cbf_clf_controller.batch_controller import BatchController
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.residual_policy import ResidualPolicy

from rabbit_residual.plants import described, draw_plant, ranges
from rabbit_residual.ppo import Rollout

STONES = 10  # of an episode
AGAIN = 0.6  # probability that a plant on which an episode failed is walked once more
STONE, FAILURE, EFFORT = 1.0, -5.0, -0.004  # rewards: a step taken; an episode's bad end; times |a|^2 of a tick
KNOWN = len(ranges()) + 2  # what `Rollout.known` has of a tick
CONTROLLERS: dict[Terrain, str] = {"stones": "rl-cbf-clf-qp", "flat": "rl-clf-qp"}


class Exploring(ResidualPolicy):
    """What `act` says, cut to [-1, 1]; `reads` and `said`: of the last tick, not cut."""

    version = "exploring"

    def __init__(self, act: Callable[[Array], Array]) -> None:
        super().__init__()
        self._act = act

    def says(self, reads: Array) -> Array:
        """See `ResidualPolicy`."""
        self.reads, self.said = reads, self._act(reads)
        return self.said.clip(-1, 1)


class Fleet:
    """`robots` robots on one terrain, under the best controller with DAQP; plants and episodes follow from `seed`."""

    def __init__(self, terrain: Terrain, robots: int, act: Callable[[Array], Array], seed: list[int]) -> None:
        self.terrain, self.ends = terrain, list[tuple[bool, int]]()
        parameters = load_parameters("best", controller=CONTROLLERS[terrain], qp_solver="daqp")
        self._gait, self._rng = load_gaits(parameters.gait), np.random.default_rng(seed)
        self._policy = Exploring(act)
        self._controller = BatchController(Controller(parameters, self._gait, self._policy), [self._policy] * robots)
        episodes = [self._episode() for _ in range(robots)]
        self._batch = BatchSimulation([plant for plant, _ in episodes])
        self._batch.reset([seed for _, seed in episodes])
        for robot, (_, episode) in enumerate(episodes):
            self._controller.reset(robot, episode)
        self._steps = np.zeros(robots, dtype=int)
        self._known = np.array([described(plant.parameters) for plant, _ in episodes])

    def walk(self, ticks: int) -> Rollout:
        """So many ticks and one more. `ends` then has how each episode ended: whether walked, and its steps."""
        self.ends = []
        rows = [self._tick() for _ in range(ticks + 1)]
        return Rollout(*(np.array(part) for part in zip(*rows, strict=True)))

    def _tick(self) -> tuple[Array, ...]:
        known = np.concatenate([self._known, self._steps[:, None] / STONES], axis=1)
        output, policy = self._controller.step(self._batch.states), self._policy
        states = self._batch.step(output.torque)
        effort = (policy.said.clip(-1, 1) ** 2).sum(axis=1)
        reward = STONE * (states.touchdowns - self._steps) + EFFORT * effort
        self._steps = states.touchdowns.copy()
        ended, failed = ~states.running, np.zeros(len(states), dtype=bool)
        refused = {*output.scene.faults, *output.scene.errors}
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
            self._controller.reset(robot, episode)
            self._steps[robot] = 0
        reward[failed] += FAILURE
        return policy.reads, known, policy.said, reward, ended, failed

    def _episode(self) -> tuple[Simulation, int]:
        seed = int(self._rng.integers(2**32))
        parameters = draw_plant(self.terrain, np.random.default_rng([seed, 1]), STONES)
        return make_simulation(parameters, self._gait), seed
