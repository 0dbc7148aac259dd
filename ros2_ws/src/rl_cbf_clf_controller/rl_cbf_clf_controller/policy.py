"""Policies on the control path: what gives alpha and beta of every quantity at a tick. No torch here.

The actor is the paper's network, 400-300 with ReLU and tanh outputs in [-1, 1], times fixed action scales. With the
structured form (the default), the CLF's outputs are a 4x5 matrix [D2 | D1] contracted with LgV, as the paper's own
expression Delta^v = 2 eta' P G Delta = LgV Delta [eq70] says:

    alpha_V = scale_alpha LgV D2,    beta_V = scale_beta LgV D1

Plain, they are 5 outputs times (|LgV| + 1). Either way the action is the paper's (25 values on stones).
"""

from abc import abstractmethod
from collections.abc import Collection, Sequence
from dataclasses import dataclass
from functools import cache

import numpy as np
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.problem import Problem
from cbf_clf_qp.tick import Estimator, Pending, Terms
from cbf_clf_qp.tracing import Traced
from rabbit_description.state import Array

from rl_cbf_clf_controller.scene import Scene
from rl_cbf_clf_controller.weights import Actor, PolicyFile


class Policy(Estimator[Scene]):
    """An estimator that has a `version`, which is echoed with every torque.

    `adaptation` names the one that its estimates add to; None: they fit any.
    """

    version: str
    adaptation: str | None = None


class LearnedPolicy(Policy):
    """A policy that sees of a tick only its observation and LgV, and nothing of a model."""

    @abstractmethod
    def act(self, observation: Array, LgV: Array) -> Estimates:
        """The estimates at `observation` (m,), raw, see `Problem.observation`, and `LgV` (4,)."""

    def estimate(self, terms: Terms[Scene], before: Estimates) -> Estimates:
        """At a tick."""
        return self.act(terms.scene.observation, terms.scene.LgV)


class ZeroPolicy(LearnedPolicy):
    """No correction: the same controller becomes the nominal one."""

    version = "zero"

    def __init__(self, problem: Problem) -> None:
        n, m = len(problem.quantities), problem.inputs
        self._estimates = Estimates.zero(n, m)
        self._pending: Pending = self._estimates
        if problem.has_clf:  # in the form of an actor, so that a tick that takes one over has its trace
            self._pending = NetworkOutputs(np.zeros((m + 1) * (m + n - 1)), np.zeros(n), np.zeros(n), True, True)

    def act(self, observation: Array, LgV: Array) -> Estimates:
        """Zeros, wherever the robot is."""
        return self._estimates

    def pending(self, terms: Terms[Scene], before: Sequence[Pending]) -> Pending:
        """What zeros come of."""
        return self._pending


@dataclass
class NetworkOutputs:
    """An actor's outputs, in [-1, 1], of which the tick's trace makes estimates; the scales (n,) of alpha and beta."""

    outputs: Array
    alpha_scale: Array
    beta_scale: Array
    structured: bool
    has_clf: bool

    def at(self, terms: Terms[Scene]) -> Estimates:
        """At a tick."""
        return self.along(terms.scene.LgV)

    def along(self, LgV: Array) -> Estimates:
        """Where V-dot's slope is `LgV` (m,)."""
        m, outputs = LgV.size, self.outputs
        raw = Estimates.from_flat(contract(outputs, LgV) if self.structured else outputs, m)
        alpha, beta = raw.alpha * self.alpha_scale[:, None], raw.beta * self.beta_scale
        if self.structured:
            matrix = outputs[: m * (m + 1)].reshape(m, m + 1)
            error = Affine(self.alpha_scale[0] * matrix[:, :m], self.beta_scale[0] * matrix[:, m])
            return Estimates(alpha, beta, error)
        if self.has_clf:
            size = np.sqrt(LgV @ LgV) + 1
            alpha[0], beta[0] = alpha[0] * size, beta[0] * size
        return Estimates(alpha, beta)


class ActorPolicy(LearnedPolicy):
    """The actor's forward pass in numpy, from a checked policy file."""

    def __init__(self, file: PolicyFile) -> None:
        self.file = file
        self.version = file.version
        form = file.metadata
        self.adaptation = form.adaptation or "none"
        self._center = np.array(form.observation_center)
        self._inverse_scale = 1 / np.array(form.observation_scale)
        self._form = np.array(form.alpha_scale), np.array(form.beta_scale), form.structured, "V" in form.names
        self._actor = Actor(file.arrays)
        self._estimates = traced_estimates().twin()

    def act(self, observation: Array, LgV: Array) -> Estimates:
        """Alpha and beta of every quantity. A network without `l_min` reads the first 14 observations.

        Raises:
            ValueError: it reads the step length of a gait library, and there is none.
        """
        estimates: Estimates = self._estimates(self._outputs(observation), LgV)[0]
        return estimates

    def pending(self, terms: Terms[Scene], before: Sequence[Pending]) -> Pending:
        """The network's outputs at a tick."""
        return self._outputs(terms.scene.observation)

    def _outputs(self, observation: Array) -> NetworkOutputs:
        size = self._center.size
        if observation.size != size:
            if observation.size < size:
                read = self.file.metadata.observation[-1]
                raise ValueError(f"policy {self.version} reads {read}: expected a gait library")
            observation = observation[:size]
        return NetworkOutputs(self._actor((observation - self._center) * self._inverse_scale), *self._form)


class PartlyNominal(Policy):
    """`policy`, but for some quantities, `nominal` by name: their estimates are zero, so their rows are nominal."""

    def __init__(self, policy: Policy, problem: Problem, nominal: Collection[str]) -> None:
        zeroed = [name for name in problem.quantities if name in nominal]
        self.version = f"{policy.version}, nominal {','.join(zeroed)}"
        self.adaptation = policy.adaptation
        self._policy = policy
        self._outputs_kept = "V" not in zeroed
        self._inputs = problem.inputs
        self._kept = np.array([name not in zeroed for name in problem.quantities], dtype=float)

    def estimate(self, terms: Terms[Scene], before: Estimates) -> Estimates:
        """The policy's estimates, zero in the rows of the nominal quantities; the outputs go with V."""
        estimates = self._policy.estimate(terms, before)
        outputs = estimates.output_error if self._outputs_kept else Affine.zero(self._inputs, self._inputs)
        return Estimates(estimates.alpha * self._kept[:, None], estimates.beta * self._kept, outputs)


@cache
def traced_estimates() -> Traced:
    """From a network's outputs to alpha, beta and, of the structured form, the outputs' error."""
    return Traced(lambda outputs, LgV: [outputs.along(LgV)])


def contract(outputs: Array, LgV: Array) -> Array:
    """Structured outputs (20 + 5(n - 1),) to the flat vector (5n,): the first 20 are [D2 | D1] (4, 5), row by row.

    With m inputs in place of 4: m (m + 1) + (m + 1)(n - 1) and (m + 1) n.
    """
    m = LgV.size
    clf, others = LgV @ outputs[: m * (m + 1)].reshape(m, m + 1), outputs[m * (m + 1) :]
    alphas = others.size // (m + 1) * m
    return np.concatenate([clf[:m], others[:alphas], clf[m:], others[alphas:]])
