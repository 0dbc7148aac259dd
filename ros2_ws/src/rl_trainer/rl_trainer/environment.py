"""The same walk as a `gymnasium.Env`, for learners of one's own: action alpha and beta, reward the paper's.

    observation   (m,) scaled, see `Problem.units`
    action        (5n,) in [-1, 1], times the action scales: all alphas, then all betas (25 on stones)
    reward        -weighted squared errors of the tick - failure penalty
    info          the fields of the tick's `Transition`; `next_LgV` also after a reset

A tick's observation is needed before its action, while a controller gives both at once; so a second controller, the
scout, looks at each state first. Which leg stands and all that is measured do not depend on the policy.
"""

from collections.abc import Callable
from typing import Any

import gymnasium
import numpy as np
from cbf_clf_qp.estimates import Estimates
from gymnasium.spaces import Box
from numpy.typing import NDArray
from rabbit_description.state import Array, RobotState
from rl_cbf_clf_controller.policy import LearnedPolicy, Policy, ZeroPolicy

from rl_trainer.parameters import TrainingParameters
from rl_trainer.reward import reward
from rl_trainer.rollout import Controller, Simulation
from rl_trainer.transitions import TransitionBuilder

Float32 = NDArray[np.float32]


class GivenAction(LearnedPolicy):
    """A policy that answers with the action it was given, and the spaces of one robot."""

    version = "environment"

    def __init__(self, parameters: TrainingParameters) -> None:
        self.action: Array = np.zeros((parameters.problem.inputs + 1) * parameters.n)
        self._center, self._scale = np.array([parameters.problem.unit(name) for name in parameters.observation]).T
        self.observation_space = Box(-np.inf, np.inf, self._center.shape, np.float32)
        self.action_space = Box(-1.0, 1.0, self.action.shape, np.float32)
        alpha, beta, _ = parameters.scales
        self._alpha_scale, self._beta_scale = np.array(alpha)[:, None], np.array(beta)
        self._has_clf, self._inputs = parameters.problem.has_clf, parameters.problem.inputs

    def act(self, observation: Array, LgV: Array) -> Estimates:
        """The action times its scales; that of V also times |LgV| + 1."""
        return self.estimates(self.action[None], LgV[None])[0]

    def estimates(self, actions: Array, LgV: Array) -> Estimates:
        """Of N robots with these actions (N, (m + 1) n), at LgV (N, m)."""
        slopes, beta = np.split(actions, [self._inputs * len(self._beta_scale)], axis=1)
        size = np.ones(beta.shape)
        if self._has_clf:
            size[:, 0] += np.linalg.norm(LgV, axis=1)
        alpha = slopes.reshape(*beta.shape, self._inputs) * self._alpha_scale * size[..., None]
        return Estimates(alpha, beta * self._beta_scale * size, None)

    def scaled(self, observation: Array) -> Float32:
        """What a learner sees of observations (..., k)."""
        seen: Float32 = ((observation[..., : len(self._center)] - self._center) / self._scale).astype(np.float32)
        return seen


class WalkingEnv(gymnasium.Env[Float32, Float32]):
    """One episode is one walk of the simulation that was passed in; a time limit or a fault truncates it."""

    def __init__(
        self,
        parameters: TrainingParameters,
        simulation: Simulation,
        make_controller: Callable[[Policy, float], Controller],
    ) -> None:
        self.parameters, self._simulation = parameters, simulation
        self._policy, self._builder = GivenAction(parameters), TransitionBuilder(parameters)
        self._controller = make_controller(self._policy, parameters.sigma)
        self._scout = make_controller(ZeroPolicy(parameters.problem), 0.0)
        self.observation_space, self.action_space = self._policy.observation_space, self._policy.action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Float32, dict[str, Any]]:
        """A new walk; its course, first state and noise follow from the seed."""
        super().reset(seed=seed)
        episode = int(self.np_random.integers(2**32))
        self._state: RobotState = self._simulation.reset(episode)
        self._controller.reset(episode)
        self._scout.reset(episode)
        seen = self._scout.step(self._state)
        return self._policy.scaled(seen.observation), {"next_LgV": seen.LgV}

    def step(self, action: Float32) -> tuple[Float32, float, bool, bool, dict[str, Any]]:
        """One tick with `action` (5n,) as the estimates."""
        self._policy.action = np.asarray(action, dtype=float)
        output = self._controller.step(self._state)
        self._builder.reset()
        self._builder.add(self._state, output)
        self._state = self._simulation.step(output.torque)
        if self._state.running:
            scouted = self._scout.step(self._state)
            transition = self._builder.add(self._state, scouted)
        else:
            scouted, transition = output, self._builder.add(self._state)
        if transition is None:
            raise RuntimeError(f"tick {self._state.tick} does not follow tick {output.tick}")
        truncated = not transition.failed and (not self._state.running or bool(output.fault))
        earned = reward(transition, self.parameters)
        return self._policy.scaled(scouted.observation), earned, transition.failed, truncated, vars(transition).copy()
