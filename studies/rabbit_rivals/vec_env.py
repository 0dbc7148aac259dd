"""Vector environments as one VecEnv of stable-baselines3."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from rabbit_experiments.vector_environment import EpisodesEnv
from stable_baselines3.common.vec_env import VecEnv


class SideBySide(VecEnv):
    """The robots of `environments`, whose spaces are the same; episodes restart in the same step.

    What an environment tells in `infos` of each robot, the learner gets under that name.
    """

    def __init__(self, environments: Sequence[EpisodesEnv]) -> None:
        self.environments = environments
        sizes = [environment.num_envs for environment in environments]
        self._ends = np.cumsum(sizes)[:-1]
        super().__init__(sum(sizes), environments[0].single_observation_space, environments[0].single_action_space)

    def reset(self) -> Any:
        """New episodes from the seeds that `seed` set; without it go on with the robots' generators."""
        parts = zip(self.environments, np.split(np.array(self._seeds, dtype=object), self._ends), strict=True)
        observations = np.concatenate([environment.reset(seed=[*seeds])[0] for environment, seeds in parts])
        self._reset_seeds()
        return observations

    def step_async(self, actions: Any) -> None:
        """See `VecEnv`."""
        self._actions = actions

    def step_wait(self) -> Any:
        """See `VecEnv`."""
        parts = zip(self.environments, np.split(self._actions, self._ends), strict=True)
        steps = [environment.step(actions) for environment, actions in parts]
        observations, rewards, failed, cut = map(np.concatenate, list(zip(*steps, strict=True))[:4])
        infos: list[dict[str, Any]] = []
        for *_, truncated, told in steps:
            last, has_ended = told.pop("final_obs", None), told.pop("_final_obs", None)
            for i in range(len(truncated)):
                infos.append({name: rows[i] for name, rows in told.items()})
                if has_ended is not None and has_ended[i]:
                    infos[-1] |= {"terminal_observation": last[i], "TimeLimit.truncated": bool(truncated[i])}
        return observations, rewards.astype(np.float32), failed | cut, infos

    def close(self) -> None:
        """Closes nothing: nothing is open."""

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """The attribute of each robot's environment."""
        values = [getattr(part, attr_name) for part in self.environments for _ in range(part.num_envs)]
        return [values[i] for i in self._get_indices(indices)]

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Sets the attribute of all environments."""
        for environment in self.environments:
            setattr(environment, attr_name, value)

    def env_method(self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any) -> list[Any]:
        """Calls nothing: no learner of this project does."""
        raise NotImplementedError(method_name)

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """They are not."""
        return [False for _ in self._get_indices(indices)]
