"""N walks at once as a `gymnasium.vector.VectorEnv`: actions, observations and rewards of `WalkingEnv`, a row a robot.

A robot whose episode has ended begins another one in the same step (`AutoresetMode.SAME_STEP`), if wanted as another
robot: `make_plant` gives the one of an episode's seed. Environment i draws its seeds as a `WalkingEnv` does that was
reset with seed + i. `infos` has `next_LgV` (N, m), each tick's `transition`, and `final_obs` of those that ended.
"""

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any, Protocol

import numpy as np
from gymnasium.utils.seeding import np_random
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray
from rabbit_description.robot_states import RobotStates
from rabbit_description.state import Array
from rl_cbf_clf_controller.batch_controller import BatchController, BatchScene

from rl_trainer.environment import Float32, GivenAction
from rl_trainer.parameters import TrainingParameters
from rl_trainer.reward import reward
from rl_trainer.transitions import TransitionBuilder


class Batch(Protocol):
    """What an environment needs of N plants."""

    states: RobotStates

    def reset(self, seeds: Sequence[int]) -> RobotStates: ...

    def restart(self, i: int, simulation: Any, seed: int) -> None: ...

    def step(self, torques: Array) -> RobotStates: ...


class VectorWalkingEnv(VectorEnv[Float32, Float32, NDArray[Any]]):
    """`make_batch` puts plants together; `controller` has `details`, and no adaptation (ValueError)."""

    def __init__(
        self,
        parameters: TrainingParameters,
        controller: BatchController,
        make_plant: Callable[[int], Any],
        make_batch: Callable[[list[Any]], Batch],
    ) -> None:
        if (adaptation := controller.parameters.adaptation) != "none":
            raise ValueError(f"adaptation = {adaptation}: expected none in a vector environment")
        self.parameters, self._controller = parameters, controller
        self._make_plant, self._make_batch = make_plant, make_batch
        self._policy, self._builder = GivenAction(parameters), TransitionBuilder(parameters)
        self.num_envs = len(controller.policies)
        self.metadata = {"autoreset_mode": AutoresetMode.SAME_STEP}
        self.single_observation_space = self._policy.observation_space
        self.single_action_space = self._policy.action_space
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._rngs = [np_random(None)[0] for _ in range(self.num_envs)]

    def reset(
        self, *, seed: int | list[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float32, dict[str, Any]]:
        """New walks; their robots, courses, first states and noise follow from the seed."""
        seeds = seed if isinstance(seed, list) else [seed if seed is None else seed + i for i in range(self.num_envs)]
        self._rngs = [rng if each is None else np_random(each)[0] for rng, each in zip(self._rngs, seeds, strict=True)]
        episodes = [self._next_episode(i) for i in range(self.num_envs)]
        self._batch = self._make_batch([self._make_plant(episode) for episode in episodes])
        self._batch.reset(episodes)
        for i, episode in enumerate(episodes):
            self._controller.reset(i, episode)
        self._scene = self._controller.look(self._batch.states)
        return self._policy.scaled(self._scene.observation), {"next_LgV": self._scene.seen.LgV.copy()}

    def step(self, actions: Float32) -> tuple[Float32, NDArray[Any], NDArray[Any], NDArray[Any], dict[str, Any]]:
        """One tick with `actions` (N, 5n) as the estimates."""
        batch, controller, n = self._batch, self._controller, self.num_envs
        estimates = self._policy.estimates(np.asarray(actions, dtype=float), self._scene.seen.LgV)
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
            infos |= {"final_obs": self._policy.scaled(scene.observation), "_final_obs": has_ended}
        return self._policy.scaled(following.observation), rewards, failed, has_ended & ~failed, infos

    def _transition(self, output: Any, states: RobotStates, i: int, following: BatchScene | None) -> Any:
        """Of robot `i`, from its output to what is seen next, or to the end."""
        self._builder.reset()
        self._builder.add(states[i], output)
        if following is None:
            found = self._builder.add(states[i])
        else:
            unknown = np.full(output.mu.shape, np.nan)
            found = self._builder.add(states[i], replace(output, mu=unknown, **following.fields(i)))
        if found is None:
            raise RuntimeError(f"tick {states.tick[i]} does not follow tick {output.tick}")
        return found

    def _next_episode(self, i: int) -> int:
        return int(self._rngs[i].integers(2**32))
