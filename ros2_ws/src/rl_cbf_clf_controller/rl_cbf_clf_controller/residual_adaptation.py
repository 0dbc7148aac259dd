"""Online adaptation: what of the model's error the policy leaves, learned from the last ticks of the walk itself.

The problem. While the stance foot is pinned, the robot moves in five coordinates w: pitch, stance hip and knee, swing
hip and knee. With the mass matrix M and bias forces h in these (M_n, h_n nominal), M w'' + h = S u for torques u (4,).
So the true acceleration is the nominal one, a_0 + A u, with another gain and another drift:

    w'' = a_0 + r + C A u,      C = M^-1 M_n (5, 5),   r = M_n^-1 h_n - M^-1 h (5,), rad/s^2

Under a uniform mass scale s, C = I / s and r = 0, whatever the state; else both change along a step. A policy's
estimate of y'' is the prior: it stands for an acceleration error e(mu) (see `prior_error`), and only what is left is
learned. With C = I + D, and D = 0, r = 0 at an episode's beginning, that is

    w'' - (a_0 + A u + e) = D A u + r

D is fitted by recursive least squares (`least_squares.py`), r is a low-pass (FILTER_TIME) of what D does not explain,
and of the stance foot's force (F_N, F_T), N, f is the same low-pass of measured minus predicted.

Measured are, over the tick that ends now, (w'(k) - w'(k-1)) / dt and the mean force. Predicted is the mean of the
model's values at both ends, under the torque as applied, after saturation. Motors lag, and D would take that for a
weaker, r for another plant: so the torque's mean over the tick is u(k-1) + lag (u(k-2) - u(k-1)), and the scalar `lag`,
0 for ideal motors, is fitted as well, ahead of D. It corrects the measurement alone; the QP is not told of it.

Assumed: the torque command is held for the tick, the stance foot is pinned and alone on the ground, the robot's error
looks the same from either leg. So all is held in the tick of a touchdown, in flight, with the swing foot on the ground,
over a gap in the ticks, and in the SETTLING ticks after any of these: a foot that bounces lands twice. When the legs
swap all stay as they are: they are in stance/swing order, as the coordinates are.

Into the QP they go as alpha and beta. With J the rows of V, B1, B2 over w'' (LgV J_y and the barriers' Jacobians), and
the pre-control u~(mu) still the nominal one,

    alpha mu + beta = J (e(mu) + D A u~(mu) + r),     for F_N, F_T: policy's + f
    Delta_2 mu + Delta_1 = J_y (e(mu) + D A u~(mu) + r)

For V that is the policy's own estimate and what is learned. For B1 and B2 it stands in place of the policy's: the two
would disagree on the fifth component, of which the outputs know nothing, and that one is measured.
"""

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from rabbit_description.state import TICK_SECONDS, Array

from rl_cbf_clf_controller.affine import Affine
from rl_cbf_clf_controller.context import ModelContext
from rl_cbf_clf_controller.least_squares import MatrixFit, ScalarFit
from rl_cbf_clf_controller.nominal_model import NORMAL_TANGENTIAL
from rl_cbf_clf_controller.uncertainty import Estimates

PINNED = slice(2, 7)  # pitch and joints among the coordinates; the pinned foot leaves the base no choice
SIZE = 5
SETTLING = 2  # ticks on the ground before what is measured counts
CONTACT_FORCE = 1.0  # N; a foot that carries less is in the air
FILTER_TIME = 0.02  # s
GAIN_PRIOR = 0.3  # variance of D's entries at an episode's beginning
GAIN_WALK = 1e-4  # that they gain each tick
LAG_PRIOR = 0.04  # variance of the lag
MOST_LAG = 0.8  # of a tick's change of torque
NOISE = 30.0  # rad/s^2, of what is left beside D A u


@dataclass(frozen=True)
class Measured:
    """What is known of the tick that ends now: `torque` (4,), as applied, N m, stance/swing order, or NaN.

    `force` (2, 2), N: rows stance, swing foot; columns tangential, normal.
    """

    tick: int
    torque: Array
    force: Array


@dataclass(frozen=True)
class Adapted:
    """C (5, 5), r (5,) in rad/s^2 and f (2,) = (F_N, F_T) in N."""

    effectiveness: Array
    acceleration_residual: Array
    force_residual: Array


@dataclass(frozen=True)
class Prediction:
    """By model and policy, affine in u: `acceleration` w'' (5) and `force` (F_N, F_T); `input_matrix` the nominal A."""

    acceleration: Affine
    force: Affine
    input_matrix: Array

    def mean(self, other: "Prediction") -> "Prediction":
        """Half of each."""
        acceleration, force = self.acceleration + other.acceleration, self.force + other.force
        return Prediction(
            Affine(acceleration.a / 2, acceleration.b / 2),
            Affine(force.a / 2, force.b / 2),
            (self.input_matrix + other.input_matrix) / 2,
        )


@dataclass(frozen=True)
class Tick:
    """What is kept of a tick: when, the rates w' (5,), the torque that led to it, and the prediction at it."""

    number: int
    rates: Array
    torque: Array
    prediction: Prediction


class Adaptation(Protocol):
    """Improves the policy's estimates tick by tick."""

    adapted: Adapted

    def reset(self) -> None: ...

    def estimate(self, context: ModelContext, prior: Estimates, measured: Measured) -> Estimates: ...


UNADAPTED = Adapted(np.eye(SIZE), np.zeros(SIZE), np.zeros(2))


class NoAdaptation:
    """The policy's estimates as they are."""

    adapted = UNADAPTED

    def reset(self) -> None:
        """Nothing is kept."""

    def estimate(self, context: ModelContext, prior: Estimates, measured: Measured) -> Estimates:
        """`prior`."""
        return prior


class ResidualAdaptation:
    """D, r, f and the motors' lag of an episode, and the estimates with them."""

    def __init__(self) -> None:
        self._share = 1 - np.exp(-TICK_SECONDS / FILTER_TIME)
        self.reset()

    def reset(self) -> None:
        """Begin an episode: C = I, r = 0, f = 0, no lag."""
        self._gain = MatrixFit(SIZE, GAIN_PRIOR, NOISE, GAIN_WALK)
        self._lag = ScalarFit(LAG_PRIOR, NOISE, MOST_LAG)
        self._last: Tick | None = None
        self._quiet = 0  # ticks on end of pinned walking
        self.adapted = UNADAPTED

    def estimate(self, context: ModelContext, prior: Estimates, measured: Measured) -> Estimates:
        """Learn from the tick that ends now, then add what is known to `prior`, which has an `output_error`."""
        last = self._last
        now = Tick(measured.tick, context.dq_s[PINNED], measured.torque, predict(context, prior))
        self._quiet = self._quiet + 1 if last and is_pinned(last, measured) else 0
        if last and self._quiet > SETTLING:
            rate = (now.rates - last.rates) / TICK_SECONDS
            self.learn(last.prediction.mean(now.prediction), rate, measured, last.torque)
        self._last = now
        return add(context, prior, self.adapted)

    def learn(self, predicted: Prediction, rate: Array, measured: Measured, torque_before: Array) -> None:
        """From a tick's mean prediction, measured w'' `rate` (5,), and the torque (4,) of the tick before it."""
        u = measured.torque + self._fit_lag(predicted, rate, measured.torque, torque_before)
        pushed, left = predicted.input_matrix @ u, rate - predicted.acceleration(u)
        self._gain.update(left, pushed)
        gain, r, f = self._gain.value, self.adapted.acceleration_residual, self.adapted.force_residual
        unexplained = left - gain @ pushed
        force = measured.force[0, NORMAL_TANGENTIAL] - predicted.force(u)
        self.adapted = Adapted(np.eye(SIZE) + gain, r + self._share * (unexplained - r), f + self._share * (force - f))

    def _fit_lag(self, predicted: Prediction, rate: Array, torque: Array, before: Array) -> Array:
        """By how much the torque's mean over the tick differs from the command, (4,), N m."""
        gain, A = self._gain.value, predicted.input_matrix
        late = predicted.acceleration.a @ (before - torque) + gain @ A @ (before - torque)
        left = rate - predicted.acceleration(torque) - gain @ A @ torque - self.adapted.acceleration_residual
        self._lag.update(left, late)
        return self._lag.value * (before - torque)


def make_adaptation(name: str) -> Adaptation:
    """`none` or `recursive_least_squares`."""
    return NoAdaptation() if name == "none" else ResidualAdaptation()


def is_pinned(last: Tick, measured: Measured) -> bool:
    """Whether through the tick that ends now the stance foot, and it alone, stood, and the torques are known."""
    stance, swing = measured.force[:, 1]
    return bool(
        last.number + 1 == measured.tick and np.isfinite(measured.torque).all() and swing < CONTACT_FORCE <= stance
    )


def predict(context: ModelContext, prior: Estimates) -> Prediction:
    """Nominal model and policy together, at the present state."""
    nominal = context.dynamics
    pinned = Affine(nominal.acceleration.a[PINNED], nominal.acceleration.b[PINNED])
    mu = context.quantities.outputs.second_derivative(nominal.acceleration)
    force = nominal.normal_tangential
    if context.quantities.barriers is not None:
        force += Affine(prior.alpha[3:], prior.beta[3:]).after(mu)
    return Prediction(pinned + prior_error(context, prior).after(mu), force, pinned.a)


def prior_error(context: ModelContext, prior: Estimates) -> Affine:
    """The error of w'' (5), affine in mu, that the policy's estimate of y'' stands for.

    y'' has four of the five components. The nominal model gives the fifth: w'' as if the torque were off by so much
    that y'' is; under a uniform mass scale that is exact.
    """
    if prior.output_error is None:
        raise ValueError("prior without output_error: expected estimates that tell it")
    return prior.output_error.mapped(context.dynamics.acceleration.a[PINNED] @ context.precontrol.a)


def add(context: ModelContext, prior: Estimates, adapted: Adapted) -> Estimates:
    """The estimates with what is adapted: V, B1, B2 and Delta by one error of w'', the forces by the policy's and f."""
    quantities = context.quantities
    gain = (adapted.effectiveness - np.eye(SIZE)) @ context.dynamics.acceleration.a[PINNED]
    error = prior_error(context, prior) + context.precontrol.mapped(gain, adapted.acceleration_residual)
    outputs = error.mapped(quantities.outputs.jacobian[:, PINNED])
    rows = outputs.mapped(quantities.clf_derivative.a)
    if quantities.barriers is None:
        return Estimates(rows.a, rows.b, outputs)
    barriers = error.mapped(quantities.barriers.jacobian[:, PINNED])
    return Estimates(
        np.concatenate([rows.a, barriers.a, prior.alpha[3:]]),
        np.concatenate([rows.b, barriers.b, prior.beta[3:] + adapted.force_residual]),
        outputs,
    )
