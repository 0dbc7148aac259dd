"""N walks of RABBITs in MuJoCo as a `gymnasium.vector.VectorEnv`, a row a robot, for learners of one's own.

env = VectorWalkingEnv(TrainingParameters(), load_parameters("ours", controller="rl-cbf-clf-qp"),
                       SimulationParameters(plant="mujoco", sensors="lab"), robots=64)

    observation   (k,) scaled, see `Problem.units`
    action        (5n,) in [-1, 1], times the action scales: all alphas, then all betas (25 on stones)
    reward        -weighted squared errors of the tick - failure penalty

A robot whose episode has ended begins another one in the same step (`AutoresetMode.SAME_STEP`), if wanted as another
robot. Environment i draws its seeds from seed + i. `infos` has `next_LgV` (N, m), each tick's `transition`, and
`final_obs` of those that ended. A time limit or a fault truncates an episode.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from cbf_clf_qp.batch_functions import BatchFunction
from cbf_clf_qp.estimates import Estimates
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
from rabbit_sim.simulation import Simulation
from rl_cbf_clf_controller.batch_controller import BatchController
from rl_cbf_clf_controller.batch_output import BatchScene
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.controller_output import seen_fields
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import ZeroPolicy, estimate_function
from rl_trainer.parameters import TrainingParameters
from rl_trainer.reward import reward
from rl_trainer.transitions import TransitionBuilder

from rabbit_experiments.assembly import make_simulation

Float32 = NDArray[np.float32]
Draw = Callable[[SimulationParameters, int], SimulationParameters]


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
        """Of N robots, the actions (N, (m + 1) n) times their scales; those of V also times |LgV| + 1, LgV (N, m)."""
        found = self._estimates(actions, LgV, *self._scales)
        return Estimates(found.alpha, found.beta, None)

    def scaled(self, observation: Array) -> Float32:
        """Observations (..., k) as they are seen."""
        seen: Float32 = ((observation[..., : len(self._center)] - self._center) / self._scale).astype(np.float32)
        return seen


class VectorWalkingEnv(VectorEnv[Float32, Float32, NDArray[Any]]):
    """`draw`: the plant of an episode from its seed."""

    def __init__(
        self,
        parameters: TrainingParameters,
        controller: ControllerParameters,
        plant: SimulationParameters,
        robots: int,
        draw: Draw = lambda plant, seed: plant,
    ) -> None:
        """Raises ValueError: no robot, another plant than MuJoCo's, or a controller with an adaptation."""
        if robots < 1:
            raise ValueError(f"robots = {robots}: expected at least 1")
        if plant.plant != "mujoco":
            raise ValueError(f"plant = {plant.plant}: expected mujoco")
        if controller.adaptation != "none":
            raise ValueError(f"adaptation = {controller.adaptation}: expected none in a vector environment")
        self.parameters, self._plant, self._draw = parameters, plant, draw
        self._gait = load_gaits(controller.gait)
        zero = ZeroPolicy(controller.problem)  # the actions take its place
        own = controller.model_copy(update={"sigma": parameters.sigma})
        self._controller = BatchController(Controller(own, self._gait, zero), [zero] * robots)
        self._units, self._builder = LearnerUnits(parameters), TransitionBuilder(parameters)
        self.num_envs = robots
        self.metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}
        self.single_observation_space = self._units.observations
        self.single_action_space = self._units.actions
        self.observation_space = batch_space(self.single_observation_space, robots)
        self.action_space = batch_space(self.single_action_space, robots)
        self._rngs = [np_random(None)[0] for _ in range(robots)]

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float32, dict[str, Any]]:
        """New walks; their robots, courses, first states and noise follow from the seed."""
        seeds = seed if isinstance(seed, list) else [seed if seed is None else seed + i for i in range(self.num_envs)]
        self._rngs = [rng if each is None else np_random(each)[0] for rng, each in zip(self._rngs, seeds, strict=True)]
        episodes = [self._next_episode(i) for i in range(self.num_envs)]
        self._batch = BatchSimulation([self._make_plant(episode) for episode in episodes])
        self._batch.reset(episodes)
        for i, episode in enumerate(episodes):
            self._controller.reset(i, episode)
        self._scene = self._controller.look(self._batch.states)
        return self._units.scaled(self._scene.observation), {"next_LgV": self._scene.seen.LgV.copy()}

    def step(self, actions: Float32) -> tuple[Float32, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """One tick with `actions` (N, 5n) as the estimates."""
        batch, controller, n = self._batch, self._controller, self.num_envs
        estimates = self._units.estimates(np.asarray(actions, dtype=float), self._scene.seen.LgV)
        scene, output = self._scene, controller.decide(self._scene, estimates)
        outputs = [output[i] for i in range(n)]
        states = batch.step(output.torque)
        has_ended, ends = ~states.running, {}
        has_ended[[*scene.faults, *scene.errors]] = True
        for i in has_ended.nonzero()[0].tolist():
            ends[i] = self._transition(outputs[i], states, i, None)
            episode = self._next_episode(i)
            batch.restart(i, self._make_plant(episode), episode)
            controller.reset(i, episode)
        self._scene = following = controller.look(batch.states)
        transitions = [ends.get(i) or self._transition(outputs[i], states, i, following) for i in range(n)]
        rewards = np.array([reward(each, self.parameters) for each in transitions])
        failed = np.array([each.failed for each in transitions])
        infos: dict[str, Any] = {"next_LgV": following.seen.LgV.copy(), "transition": transitions}
        if has_ended.any():
            infos |= {"final_obs": self._units.scaled(scene.observation), "_final_obs": has_ended}
        return self._units.scaled(following.observation), rewards, failed, has_ended & ~failed, infos

    def _transition(self, output: Any, states: RobotStates, i: int, following: BatchScene | None) -> Any:
        """Of robot `i`, from its output to what is seen next, or to the end."""
        self._builder.reset()
        self._builder.add(states[i], output)
        if following is None:
            found = self._builder.add(states[i])
        else:
            unknown = np.full(output.mu.shape, np.nan)
            found = self._builder.add(states[i], replace(output, mu=unknown, **seen_fields(following[i])))
        if found is None:
            raise RuntimeError(f"tick {states.tick[i]} does not follow tick {output.tick}")
        return found

    def _make_plant(self, seed: int) -> Simulation:
        return make_simulation(self._draw(self._plant, seed), self._gait)

    def _next_episode(self, i: int) -> int:
        return int(self._rngs[i].integers(2**32))
