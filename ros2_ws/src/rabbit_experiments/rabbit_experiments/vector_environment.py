"""N episodes side by side as a `gymnasium.vector.VectorEnv`, a row a robot: walks of RABBITs in MuJoCo above all.

env = VectorWalkingEnv(TrainingParameters(), load_parameters("ours", controller="rl-cbf-clf-qp"),
                       SimulationParameters(plant="mujoco", sensors="lab"), robots=64)

    observation   (k,) scaled, see `Problem.units`
    action        (5n,) in [-1, 1], times the action scales: all alphas, then all betas (25 on stones)
    reward        -weighted squared errors of the tick - failure penalty

Another `WalkingEnv` says otherwise what is read, what an action means, what is paid.

A robot whose episode has ended begins another one in the same step (`AutoresetMode.SAME_STEP`), if wanted as another
robot. Environment i draws its seeds from seed + i. `final_obs` in `infos` is what those that ended read last, before
the tick that ended them. A time limit truncates an episode; so does a fault, where actions are estimates, and then
`infos` also has `next_LgV` (N, m) and each tick's `transition`.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from cbf_clf_qp.batch_functions import BatchFunction
from cbf_clf_qp.estimates import Estimates
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box
from gymnasium.utils.seeding import np_random
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray
from rabbit_description.gait import load_gaits
from rabbit_description.robot_states import RobotStates
from rabbit_description.state import Array
from rabbit_sim.batch_simulation import BatchSimulation
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.simulation import Landing, Outcome, Simulation
from rl_cbf_clf_controller.batch_controller import BatchController
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.controller_output import seen_fields
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import ZeroPolicy, estimate_function
from rl_trainer.parameters import TrainingParameters
from rl_trainer.reward import reward
from rl_trainer.transitions import Transition, TransitionBuilder

from rabbit_experiments.assembly import Assembly, make_simulation

Rows = NDArray[Any]
Draw = Callable[[SimulationParameters, int], SimulationParameters]


class EpisodesEnv(VectorEnv[Rows, Rows, Rows], ABC):
    """`robots` episodes side by side, seeds for each robot, and the next episode in the step in which one ends.

    `infos`: what a learner may want to know besides.
    """

    def __init__(self, robots: int, observations: Box, actions: Box) -> None:
        self.num_envs = robots
        self.metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}
        self.single_observation_space, self.single_action_space = observations, actions
        self.observation_space, self.action_space = batch_space(observations, robots), batch_space(actions, robots)
        self._rngs = [np_random(None)[0] for _ in range(robots)]
        self.infos = dict[str, Any]()

    @abstractmethod
    def begin(self, robots: list[int], seeds: list[int]) -> None:
        """The next episodes of these robots; of all at a reset."""

    @abstractmethod
    def look(self) -> Rows:
        """What is read (N, k) of where the robots are now."""

    @abstractmethod
    def advance(self, actions: Array) -> Rows:
        """A tick of all under `actions` (N, m); returns whose episodes it ended, (N,)."""

    @abstractmethod
    def score(self) -> tuple[Array, Rows]:
        """The tick's rewards (N,), and which episodes it ended badly; asked once the robots have been looked at."""

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Rows, dict[str, Any]]:
        """New episodes; robots, courses, first states and noise follow from the seed."""
        seeds = seed if isinstance(seed, list) else [seed if seed is None else seed + i for i in range(self.num_envs)]
        self._rngs = [rng if s is None else np_random(s)[0] for rng, s in zip(self._rngs, seeds, strict=True)]
        self._begin(range(self.num_envs))
        self._observations = self._look()
        return self._observations, self.infos

    def step(self, actions: Rows) -> tuple[Rows, Rows, Rows, Rows, dict[str, Any]]:
        """One tick of all; raises `ResetNeeded` before the first reset."""
        if not hasattr(self, "_observations"):
            raise ResetNeeded("step: expected a reset before it")
        ended, last = self.advance(np.asarray(actions, dtype=float)), self._observations
        self._begin(ended.nonzero()[0].tolist())
        self._observations = self._look()
        rewards, failed = self.score()
        infos = self.infos | ({"final_obs": last.copy(), "_final_obs": ended} if ended.any() else {})
        return self._observations, rewards, failed, ended & ~failed, infos

    def _look(self) -> Rows:
        return self.look().astype(self.single_observation_space.dtype)

    def _begin(self, robots: Iterable[int]) -> None:
        self.begin([*robots], [int(self._rngs[i].integers(2**32)) for i in robots])


@dataclass(frozen=True)
class Tick:
    """A tick of N robots: where it took them; `landings` of those that took a step; who ended, who walked, (N,)."""

    states: RobotStates
    landings: dict[int, Landing]
    ended: Rows
    walked: Rows


class WalkingEnv(EpisodesEnv):
    """Walks in MuJoCo under one `controller`; `plant`: that of an episode, from its seed.

    `again`: the probability that a plant on which an episode ended badly is walked once more.
    """

    def __init__(
        self,
        controller: BatchController,
        observations: Box,
        actions: Box,
        robots: int,
        plant: Callable[[int], SimulationParameters],
        again: float = 0.0,
    ) -> None:
        super().__init__(robots, observations, actions)
        self.controller, self._plant, self._again = controller, plant, again
        self._batch = BatchSimulation([])
        self._gait = load_gaits(controller.parameters.gait)

    @abstractmethod
    def act(self, actions: Array) -> tuple[Array, Iterable[int]]:
        """The torques (N, 4) of `actions` (N, m) where it has looked last; and robots whose episode must end."""

    @property
    def states(self) -> RobotStates:
        """Where the robots are."""
        return self._batch.states

    def begin(self, robots: list[int], seeds: list[int]) -> None:
        if len(robots) == self.num_envs:
            self.close_extras()
            self._batch = BatchSimulation([make_simulation(self._plant(seed), self._gait) for seed in seeds])
            self._batch.reset(seeds)
        else:
            for i, seed in zip(robots, seeds, strict=True):
                self._batch.restart(i, self._next_simulation(i, seed), seed)
        for i, seed in zip(robots, seeds, strict=True):
            self.begin_as(i, self._batch.simulations[i].parameters, seed)

    def close_extras(self, **_: Any) -> None:
        """Close the plants: an engine's memory is not given back otherwise."""
        for simulation in self._batch.simulations:
            simulation.close()

    def begin_as(self, i: int, plant: SimulationParameters, seed: int) -> None:
        """Robot `i` has begun an episode as this plant."""
        self.controller.reset(i, seed)

    def advance(self, actions: Array) -> Rows:
        batch, before = self._batch, self.states.touchdowns.copy()
        torque, refused = self.act(actions)
        states = batch.step(torque)
        ended = ~states.running
        ended[[*refused]] = True
        stepped = (states.touchdowns > before).nonzero()[0].tolist()
        landings = {i: batch.simulations[i].landings[-1] for i in stepped}
        walked = ended & [simulation.outcome is Outcome.WALKED for simulation in batch.simulations]
        self.tick = Tick(states.kept(np.arange(len(states))), landings, ended, walked)
        return ended

    def _next_simulation(self, i: int, seed: int) -> Simulation:
        simulation = self._batch.simulations[i]
        if self._again and not self.tick.walked[i] and self._rngs[i].random() < self._again:
            return simulation
        simulation.close()
        return make_simulation(self._plant(seed), self._gait)


class LearnerUnits:
    """What a learner sees of one robot and gives it, over their scales: the spaces `observations` and `actions`."""

    def __init__(self, parameters: TrainingParameters) -> None:
        problem, n = parameters.problem, parameters.n
        self._center, self._scale = np.array([problem.unit(name) for name in parameters.observation]).T
        self._estimates = BatchFunction(estimate_function(n, problem.inputs, False, problem.has_clf))
        self._scales = tuple(map(np.array, parameters.scales[:2]))
        self.observations = Box(-np.inf, np.inf, self._center.shape, np.float32)
        self.actions = Box(-1.0, 1.0, ((problem.inputs + 1) * n,), np.float32)

    def estimates(self, actions: Array, LgV: Array) -> Estimates:
        """N robots' actions (N, (m + 1) n) times their scales; those of V also times |LgV| + 1, LgV (N, m)."""
        estimates = self._estimates(actions, LgV, *self._scales)
        return Estimates(estimates.alpha, estimates.beta, None)

    def scaled(self, observation: Array) -> Rows:
        """Observations (..., k) as they are seen."""
        return ((observation[..., : len(self._center)] - self._center) / self._scale).astype(np.float32)


class VectorWalkingEnv(WalkingEnv):
    """An action is the estimates of the model's errors. `draw`: the plant of an episode from its seed."""

    def __init__(
        self,
        parameters: TrainingParameters,
        controller: ControllerParameters,
        plant: SimulationParameters,
        robots: int,
        draw: Draw = lambda plant, seed: plant,
    ) -> None:
        """Raises ValueError: no robot, another plant than MuJoCo's, or a controller with an adaptation.

        `AssemblyError`, which is one too: a controller on stones and a plant without, or ticks of another length.
        """
        if robots < 1:
            raise ValueError(f"robots = {robots}: expected at least 1")
        if plant.plant != "mujoco":
            raise ValueError(f"plant = {plant.plant}: expected mujoco")
        if controller.adaptation != "none":
            raise ValueError(f"adaptation = {controller.adaptation}: expected none in a vector environment")
        Assembly(plant, controller, "zero")  # refuses a plant that the controller does not fit
        self.parameters, self._units = parameters, LearnerUnits(parameters)
        self._builder = TransitionBuilder(parameters)
        zero = ZeroPolicy(controller.problem)  # the actions take its place
        exploring = controller.model_copy(update={"sigma": parameters.sigma})
        batch = BatchController(Controller(exploring, load_gaits(controller.gait), zero), [zero] * robots)
        spaces = self._units.observations, self._units.actions
        super().__init__(batch, *spaces, robots, lambda seed: draw(plant, seed))

    def look(self) -> Rows:
        self._scene = self.controller.look(self.states)
        self.infos = {"next_LgV": self._scene.seen.LgV.copy()}
        return self._units.scaled(self._scene.observation)

    def act(self, actions: Array) -> tuple[Array, Iterable[int]]:
        scene = self._scene
        output = self.controller.decide(scene, self._units.estimates(actions, scene.seen.LgV))
        self._outputs = [output[i] for i in range(self.num_envs)]
        return output.torque, {*scene.faults, *scene.errors}

    def score(self) -> tuple[Array, Rows]:
        transitions = self.infos["transition"] = [self._transition(i) for i in range(self.num_envs)]
        rewards = np.array([reward(transition, self.parameters) for transition in transitions])
        return rewards, np.array([transition.failed for transition in transitions])

    def _transition(self, i: int) -> Transition:
        """The transition of robot `i`, from its output to what is seen next, or to the end."""
        output, state, following = self._outputs[i], self.tick.states[i], None
        if not self.tick.ended[i]:
            unknown = np.full(output.mu.shape, np.nan)
            following = replace(output, mu=unknown, **seen_fields(self._scene[i]))
        self._builder.reset()
        self._builder.add(state, output)
        transition = self._builder.add(state, following)
        if transition is None:
            raise RuntimeError(f"tick {state.tick} does not follow tick {output.tick}")
        return transition
