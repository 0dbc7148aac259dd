"""L1 adaptation of the CLF-QP (Nguyen and Sreenath, ACC 2015): the model's error in y-ddot, estimated and cancelled.

    plant       y'' = mu + model_error,   model_error = Delta_1 + Delta_2 mu = slope |mu| + offset     [delta_IO2]
    input       mu = mu_1 + mu_2,   mu_1 of the CLF-QP on the reference model y'' = mu_1,   mu_2 = -C(s) estimate
    predictor   predicted' = F predicted + G (mu + estimate + K error),   error = predicted - eta
    adaptation  estimate = slope |mu| + offset,   s = G' P_eps error
                slope' = gain Proj(-|mu| s),   offset' = gain Proj(-s)
    filter      C(s) = cutoff / (s + cutoff),   C(0) = 1

K is the CLF's own feedback, so V(error) falls by the CLF condition but for model_error - estimate, which the adaptation
takes out of V-dot. Proj keeps |slope| and |offset| in their bounds.

Sampled: over the tick that ended, torque held, the predictor's rate minus the measured one is, apart from the error's
own dynamics, the constant

    defect = F mean(eta) + G mean(mu) - (eta - eta_last) / dt = -G model_error for a constant model error,

and the error and the estimate obey linear differential equations. `exact` solves them over a sub-step, `euler` takes
one forward step. `piecewise` is the other usual law, without a gain: the estimate is the constant that explains the
error which the tick left behind, and the predictor starts anew at what was measured. The filter is sampled exactly in
all.
"""

import casadi as ca
import numpy as np
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.constraints import ResClf
from cbf_clf_qp.estimates import Estimates
from rabbit_description.state import JOINTS, Array
from scipy.linalg import expm

from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.scene import Estimator, Scene

DY, ESTIMATE, FILTERED = 1, 2, 3  # rows of the state: predictor's error in y and y-dot, estimate, filtered estimate
STATES = 1 + FILTERED


class L1Adaptation(Estimator):
    """The adaptation's memory for m outputs of relative degree 2; `estimate` is called once a tick."""

    def __init__(self, parameters: ControllerParameters, m: int = JOINTS) -> None:
        p, self._outputs = parameters, m
        clf = ResClf(m, p.eps, (p.kp, p.kd))
        self._F, self._G, P, K = (ca.DM(matrix).full() for matrix in (clf.F, clf.G, clf.P, clf.K))
        self._law, self._gain, self._cutoff = p.l1_law, p.l1_gain, p.l1_cutoff
        self._bounds = p.l1_slope_bound, p.l1_offset_bound
        self._tick_seconds = p.tick_seconds
        self._substeps, self._h = p.l1_substeps, p.tick_seconds / p.l1_substeps
        self._closed = (self._F + self._G @ K)[::m, ::m]  # the same 2x2 for every output
        self._s = (self._G.T @ P)[0, ::m]
        self.reset()

    def reset(self) -> None:
        """Forget all: no error, no estimate."""
        m = self._outputs
        self.slope, self.offset = np.zeros(m), np.zeros(m)
        self._state = np.zeros((STATES, m))
        self._eta = np.zeros(2 * m)  # of the last tick
        self._belief: Affine | None = None

    @property
    def model_error(self) -> Array:
        """The estimated one (m,), rad/s^2, before the filter."""
        return self._state[ESTIMATE].copy()

    def estimate(self, scene: Scene, before: Estimates) -> Estimates:
        """A part of the input [approach1_input]: the outputs get the compensation through the policy's part."""
        whole = np.eye(self._outputs) + before.alpha
        y_ddot = scene.output_dynamics
        inverse = np.linalg.inv(whole)
        belief = Affine(inverse @ y_ddot.a, inverse @ (y_ddot.b - before.beta))
        compensation = self.compensation(scene.seen.eta, belief, scene.torque)
        return Estimates(np.zeros((self._outputs, self._outputs)), whole @ compensation)

    def compensation(self, eta: Array, belief: Affine, torque: Array) -> Array:
        """mu_2 (m,), rad/s^2, at `eta` (2m,), after a tick under `torque` (m,), NaN where the step is new.

        `belief` is the nominal y-ddot at this state, affine in the torque. Where the step is new, eta has jumped: the
        predictor starts at it, and the estimate stays.
        """
        if self._belief is None or np.isnan(torque).any():
            self._state[:ESTIMATE] = 0.0
        else:
            mu = (self._belief(torque) + belief(torque)) / 2  # a held torque is no held mu
            rate = self._F @ (self._eta + eta) / 2 + self._G @ mu
            self._adapt((rate - (eta - self._eta) / self._tick_seconds).reshape(2, -1), float(np.linalg.norm(mu)))
        self._eta, self._belief = eta, belief
        return -self._state[FILTERED]

    def _adapt(self, defect: Array, size: float) -> None:
        if self._law == "piecewise":
            self.offset = into_ball(-defect[1], self._bounds[1])
            decay = np.exp(-self._cutoff * self._tick_seconds)
            self._state[ESTIMATE] = self.offset
            self._state[FILTERED] = decay * self._state[FILTERED] + (1 - decay) * self.offset
            return
        step = self._step(size)
        self._state[ESTIMATE] = self.slope * size + self.offset
        for _ in range(self._substeps):
            self._state = step @ np.vstack([self._state, defect])
            share = (self._state[ESTIMATE] - self.slope * size - self.offset) / (1 + size**2)
            self.slope = into_ball(self.slope + size * share, self._bounds[0])  # as their rates share the change
            self.offset = into_ball(self.offset + share, self._bounds[1])
            self._state[ESTIMATE] = self.slope * size + self.offset

    def _step(self, size: float) -> Array:
        """(4, 6): the state after a sub-step; d/dt (state, defect) is linear in them, the same for every output."""
        rates = np.zeros((STATES + 2, STATES + 2))
        rates[:2, :2], rates[:2, STATES:] = self._closed, np.eye(2)
        rates[DY, ESTIMATE] = 1.0
        rates[ESTIMATE, :2] = -self._gain * (1 + size**2) * self._s
        rates[FILTERED, ESTIMATE], rates[FILTERED, FILTERED] = self._cutoff, -self._cutoff
        if self._law == "exact":
            return expm(rates * self._h)[:STATES]
        step = np.eye(STATES + 2) + rates * self._h
        step[FILTERED, FILTERED] = np.exp(-self._cutoff * self._h)  # the filter is no part of what Euler may spoil
        step[FILTERED, ESTIMATE] = 1 - step[FILTERED, FILTERED]
        return step[:STATES]


def into_ball(value: Array, radius: float) -> Array:
    """The point of the ball of `radius` about 0 that is nearest to `value` (m,)."""
    size = float(np.linalg.norm(value))
    return value if size <= radius else value * (radius / size)
