"""Policies on the control path: what gives alpha and beta of every quantity at a tick. No torch here.

The actor is the paper's network, 400-300 with ReLU and tanh outputs in [-1, 1], times fixed action scales. With the
structured form (the default), the CLF's outputs are a 4x5 matrix [D2 | D1] contracted with LgV, as the paper's own
expression Delta^v = 2 eta' P G Delta = LgV Delta [eq70] says:

    alpha_V = scale_alpha LgV D2,    beta_V = scale_beta LgV D1

Plain, they are 5 outputs times (|LgV| + 1). Either way the action is the paper's (25 values on stones).
"""

from abc import abstractmethod
from collections.abc import Collection
from functools import cache

import numpy as np
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.problem import Problem
from cbf_clf_qp.tick import Estimator, Terms
from cbf_clf_qp.tracing import Traced
from rabbit_description.state import Array

from rl_cbf_clf_controller.scene import Scene
from rl_cbf_clf_controller.weights import PolicyFile, forward


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
        self._estimates = Estimates.zero(len(problem.quantities), problem.inputs)

    def act(self, observation: Array, LgV: Array) -> Estimates:
        """Zeros, wherever the robot is."""
        return self._estimates


class ActorPolicy(LearnedPolicy):
    """The actor's forward pass in numpy, from a checked policy file."""

    def __init__(self, file: PolicyFile) -> None:
        self.file = file
        self.version = file.version
        form = file.metadata
        self.adaptation = form.adaptation or "none"
        self._center = np.array(form.observation_center)
        self._inverse_scale = 1 / np.array(form.observation_scale)
        self._alpha_scale, self._beta_scale = np.array(form.alpha_scale), np.array(form.beta_scale)
        self._estimates = traced_estimates(form.structured, "V" in form.names, form.m).twin()
        self.act(np.zeros(len(self._center)), np.zeros(form.m))  # traced now, not in the tick that takes it over

    def act(self, observation: Array, LgV: Array) -> Estimates:
        """Alpha and beta of every quantity. A network without `l_min` reads the first 14 observations.

        Raises:
            ValueError: it reads the step length of a gait library, and there is none.
        """
        if observation.size < self._center.size:
            raise ValueError(
                f"policy {self.version} reads {self.file.metadata.observation[-1]}: expected a gait library"
            )
        scaled = (observation[: len(self._center)] - self._center) * self._inverse_scale
        outputs = forward(self.file.arrays, scaled.astype(np.float32))
        estimates: Estimates = self._estimates(outputs, LgV, self._alpha_scale, self._beta_scale)[0]
        return estimates


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
def traced_estimates(structured: bool, has_clf: bool, inputs: int) -> Traced:
    """From a network's outputs to alpha, beta and, of the structured form, the outputs' error."""

    def estimates(outputs: Array, LgV: Array, alpha_scale: Array, beta_scale: Array) -> list[Estimates]:
        raw = Estimates.from_flat(contract(outputs, LgV) if structured else outputs, inputs)
        alpha, beta = raw.alpha * alpha_scale[:, None], raw.beta * beta_scale
        if structured:
            matrix = outputs[: inputs * (inputs + 1)].reshape(inputs, inputs + 1)
            error = Affine(alpha_scale[0] * matrix[:, :inputs], beta_scale[0] * matrix[:, inputs])
            return [Estimates(alpha, beta, error)]
        if has_clf:
            size = np.sqrt(LgV @ LgV) + 1
            alpha[0], beta[0] = alpha[0] * size, beta[0] * size
        return [Estimates(alpha, beta)]

    return Traced(estimates)


def contract(outputs: Array, LgV: Array) -> Array:
    """Structured outputs (20 + 5(n - 1),) to the flat vector (5n,): the first 20 are [D2 | D1] (4, 5), row by row.

    With m inputs in place of 4: m (m + 1) + (m + 1)(n - 1) and (m + 1) n.
    """
    m = LgV.size
    clf, others = LgV @ outputs[: m * (m + 1)].reshape(m, m + 1), outputs[m * (m + 1) :]
    alphas = others.size // (m + 1) * m
    return np.concatenate([clf[:m], others[:alphas], clf[m:], others[alphas:]])
