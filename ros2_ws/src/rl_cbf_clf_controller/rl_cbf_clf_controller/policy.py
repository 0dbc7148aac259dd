"""Policies on the control path: what gives alpha and beta of every quantity at a tick. No torch here.

The actor is the paper's network, 400-300 with ReLU and tanh outputs in [-1, 1], times fixed action scales. With the
structured form (the default), the CLF's outputs are a 4x5 matrix [D2 | D1] contracted with LgV, as the paper's
expression Delta^v = 2 eta' P G Delta = LgV Delta [eq70] says:

    alpha_V = scale_alpha LgV D2,    beta_V = scale_beta LgV D1

Plain, they are 5 outputs times (|LgV| + 1). Either way the action is the paper's (25 values on stones).

A policy fits the controller of the problem it was trained for. One for stones fits flat ground too: it is shown the
stone in whose middle the gait's step ends, and of its estimates those of V and of the outputs are taken, which are
all that a controller without barriers and force rows has a use for.
"""

from abc import ABC, abstractmethod

import casadi as ca
import numpy as np
from cbf_clf_qp.batch_functions import Bound
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.functions import NumpyFunction, Values, row_by_row
from rabbit_description.state import Array

from rl_cbf_clf_controller.network import Actor, ActorRows
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.scene import Scene
from rl_cbf_clf_controller.weights import PolicyFile

STONE_WIDTH = 0.05  # m, of the stones that the paper trains on


class Policy(ABC):
    """Learned, an oracle's, yours; its `version` is echoed with every torque.

    `adaptation` names the one that its estimates add to; None: they fit any.
    """

    version: str
    adaptation: str | None = None

    @abstractmethod
    def estimate(self, scene: Scene, before: Estimates) -> Estimates:
        """Alpha and beta of every quantity, to be added to the identified robot's, `before`; called once a tick."""

    def reset(self) -> None:  # noqa: B027  most keep nothing
        """Begin an episode: forget what the last one taught."""


class LearnedPolicy(Policy):
    """A policy that sees of a tick only its observation and LgV, and nothing of a model.

    `is_structured`: it always gives an output error.
    """

    is_structured = False

    @abstractmethod
    def act(self, observation: Array, LgV: Array) -> Estimates:
        """The estimates at `observation` (m,), raw, see `Problem.observation`, and `LgV` (4,)."""

    def act_of_many(self, observations: Array, LgV: Array) -> Estimates:
        """The same for N robots, in rows."""
        return Estimates.of_many(list(map(self.act, observations, LgV)))

    def estimate(self, scene: Scene, before: Estimates) -> Estimates:
        return self.act(scene.observation, scene.LgV)


class ZeroPolicy(LearnedPolicy):
    """No correction: the same controller becomes the nominal one."""

    version = "zero"

    def __init__(self, problem: Problem) -> None:
        self._sizes = len(problem.quantities), problem.inputs

    def act(self, observation: Array, LgV: Array) -> Estimates:
        return Estimates.zero(*self._sizes)


class ActorPolicy(LearnedPolicy):
    """The actor's forward pass, from a checked policy file. One object serves one thread."""

    def __init__(self, file: PolicyFile) -> None:
        self.file = file
        self.version = file.version
        form = file.metadata
        self.adaptation = form.adaptation or "none"
        self.center = np.array(form.observation_center)
        self.inverse_scale = 1 / np.array(form.observation_scale)
        self.is_structured = form.structured
        self.scales = np.array(form.alpha_scale), np.array(form.beta_scale)
        self.estimates = estimate_function(len(form.names), form.m, form.structured, "V" in form.names)
        self.actor = Actor(file.arrays)
        self._bind(1)

    def _bind(self, n: int) -> None:
        """Arrays of `n` robots."""
        self._network, self._LgV = ActorRows(self.actor, n), np.zeros((n, self.file.metadata.m))
        scales = (np.tile(scale, (n, 1)) for scale in self.scales)
        self._estimates = Bound(self.estimates, self._network.y, self._LgV, *scales)

    def act(self, observation: Array, LgV: Array) -> Estimates:
        """Alpha and beta of every quantity. A network without `l_min` reads the first 14 observations.

        Raises:
            ValueError: it reads the step length of a gait library, and there is none.
        """
        return self._estimates_of(self.values_of_many(observation[None], LgV[None])[0])

    def act_of_many(self, observations: Array, LgV: Array) -> Estimates:
        """The same for N robots, to the bit."""
        return self._estimates_of(self.values_of_many(observations, LgV))

    def values_of_many(self, observations: Array, LgV: Array) -> Values:
        """The same as rows: alpha, beta, and of a structured policy the output error."""
        n, size = len(observations), self.center.size
        if observations.shape[1] < size:
            read = self.file.metadata.observation[-1]
            raise ValueError(f"policy {self.version} reads {read}: expected a gait library")
        if n != len(self._LgV):
            self._bind(n)
        np.subtract(observations[:, :size], self.center, out=self._network.x)
        self._network.x *= self.inverse_scale
        self._LgV[...] = LgV
        self._network()
        return self.estimates.values(self._estimates().copy())

    def _estimates_of(self, values: Values) -> Estimates:
        return Estimates(values.alpha, values.beta, values.output_error if self.is_structured else None)


def estimate_function(n: int, m: int, structured: bool, has_clf: bool) -> NumpyFunction:
    """alpha (n, m), beta (n,) and output_error (m, m + 1) of (a network's outputs, LgV (m,), scales of both (n,)).

    Structured outputs are (m (m + 1) + (m + 1) (n - 1),): [D2 | D1] row by row, then the alphas of the other
    quantities, then their betas. Plain ones are ((m + 1) n,): alphas, then betas.
    """
    LgV, alpha_scale, beta_scale = ca.SX.sym("LgV", m), ca.SX.sym("alpha_scale", n), ca.SX.sym("beta_scale", n)
    outputs = ca.SX.sym("outputs", (m + 1) * (m + n - 1) if structured else (m + 1) * n)
    output_error = ca.SX.zeros(m, m + 1)
    if structured:
        matrix, others = row_by_row(outputs[: m * (m + 1)], m + 1), outputs[m * (m + 1) :]
        clf = LgV.T @ matrix
        alpha = ca.vertcat(clf[0, :m], row_by_row(others[: m * (n - 1)], m))
        beta = ca.vertcat(clf[0, m], others[m * (n - 1) :])
        output_error = ca.horzcat(alpha_scale[0] * matrix[:, :m], beta_scale[0] * matrix[:, m])
    else:
        alpha, beta = row_by_row(outputs[: m * n], m), outputs[m * n :]
        if has_clf:
            size = ca.vertcat(ca.norm_2(LgV) + 1, ca.SX.ones(n - 1))
            alpha, beta = ca.diag(size) @ alpha, size * beta
    estimates = {"alpha": ca.diag(alpha_scale) @ alpha, "beta": beta_scale * beta, "output_error": output_error}
    inputs = {"outputs": outputs, "LgV": LgV, "alpha_scale": alpha_scale, "beta_scale": beta_scale}
    return NumpyFunction.of("estimates", inputs, estimates, matrices=("alpha", "output_error"))


class OnFlatGround(LearnedPolicy):
    """A policy for stones where there are none; `step_length` is the gait's, m."""

    def __init__(self, policy: LearnedPolicy, step_length: float) -> None:
        self.version, self.adaptation = policy.version, policy.adaptation
        self._policy = policy
        self._stone = np.array([step_length - STONE_WIDTH / 2, step_length])

    def act(self, observation: Array, LgV: Array) -> Estimates:
        """The policy's estimates of V and of the outputs."""
        whole = self._policy.act(np.append(observation, self._stone), LgV)
        return Estimates(whole.alpha[:1], whole.beta[:1], whole.output_error)
