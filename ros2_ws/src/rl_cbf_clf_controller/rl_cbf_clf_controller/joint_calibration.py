"""Where the joints' angles are zero, found from the stance foot, which moves only as far as the ground gives.

The problem. A bent thigh and shin, or an encoder set wrongly, put knee and foot elsewhere than the measured angles
say. To first order both are an offset o of the angles: q = q_measured - (0, 0, 0, o_h, o_k, o_h, o_k). A link of
length L whose end is displaced forward by c L has turned by c, so with thigh and shin bent alike o_h = c, o_k = 0.
Foot and ground are springs with dampers. Under a force F the foot's rubber is soon pressed together by s F, the load
F_s following F with RUBBER_TIME. Soft ground takes longer than a step: d x' = F - k x, where x' is near f F - r I, with
f = 1 / d, r = k / d^2 and I the integral of F since the foot landed. The velocity of the stance foot by the corrected
kinematics is that of sinking. At the present offsets, linearised in what is left of them,

    v(q, q') = (dv/dq_h, dv/dq_k) (o - o_present) - (0, f F - r I + s F_s'),      F_s' = (F - F_s) / RUBBER_TIME

which least squares solve for (o_h, o_k, f, r, s) (`least_squares.py`), the legs being alike. A velocity and not the
foot's height: the ground need not be level. Of the knee little is believed: what this leaves out looks like an offset
of the knee that changes along the step.

How noisy the velocities are is not known either. Their variance is the mean square of what the model missed so far, and
of PRIOR numbers of VELOCITY_NOISE: at first little is believed, and more as soon as the model proves right.
"""

from typing import Any

import numpy as np
import pinocchio as pin
from cbf_clf_qp.tracing import Traced
from rabbit_description.state import TICK_SECONDS, Array

from rl_cbf_clf_controller.generated_model import make_foot_velocity
from rl_cbf_clf_controller.least_squares import LeastSquares, updated

OFFSETS = np.array([[0.0, 0, 0, 1, 0, 1, 0], [0, 0, 0, 0, 1, 0, 1]]).T  # (o_h, o_k) to q
SPREAD = np.array([0.05, 0.01, 5e-5, 3e-5, 1e-5])  # of what is sought: rad, rad, m/(N s), m/(N s^2), m/N
VELOCITY_NOISE = 0.2  # m/s
PRIOR = 20
RUBBER_TIME = 0.03  # s, damping over stiffness
SHARE = float(1 - np.exp(-TICK_SECONDS / RUBBER_TIME))
DOWN = np.array([0.0, -1.0])


class JointCalibration:
    """`value` (2,): offsets o of hips and knees, rad; `ground` (3,): f, m/(N s), r, m/(N s^2), and s, m/N."""

    def __init__(self, model: pin.Model) -> None:
        self.foot_velocity = make_foot_velocity(model)
        self._learned = traced_calibration.twin()
        self.reset()
        self.learn(np.zeros(model.nq), np.zeros(model.nv))  # traced now, not in the first tick that counts
        self.reset()

    @property
    def value(self) -> Array:
        return self._fit.value[:2]

    @property
    def ground(self) -> Array:
        return self._fit.value[2:]

    def reset(self) -> None:
        """Trust the angles and the ground again."""
        unknowns = len(SPREAD)
        self._fit = LeastSquares(np.zeros(unknowns), np.diag(SPREAD**2), np.zeros((unknowns, unknowns)))
        self._shift = np.zeros(len(OFFSETS))
        self._missed, self._count = PRIOR * VELOCITY_NOISE**2, PRIOR
        self.land()

    def corrected(self, q: Array) -> Array:
        """q (7,) from measured angles; in either order of the legs."""
        return q - self._shift

    def land(self) -> None:
        """Another foot stands, and has not sunk yet."""
        self._force = self._load = 0.0
        self._pressed = np.zeros(3)

    def press(self, force: float) -> None:
        """Take in the mean normal force on the stance foot over the last tick, N."""
        end = force + (force - self._force) / 2  # at its end it has changed by half as much
        self._load += SHARE * (force - self._load)
        impulse = -self._pressed[1] + force * TICK_SECONDS
        self._force, self._pressed = force, np.array([force, -impulse, (end - self._load) / RUBBER_TIME])

    def learn(self, q_s: Array, dq_s: Array) -> None:
        """From a corrected state (7,), stance/swing order, in which the stance foot stands."""
        fit, noise = self._fit, self._missed / self._count
        value, covariance, missed = self._learned(
            self.foot_velocity, q_s, dq_s, self._pressed, fit.value, fit.covariance, fit.walk, noise
        )
        fit.take(value, covariance)
        self._missed += float(missed)
        self._count += len(DOWN)
        self._shift = OFFSETS @ self.value


@Traced
def traced_calibration(
    foot_velocity: Any,
    q_s: Array,
    dq_s: Array,
    pressed: Array,
    value: Array,
    covariance: Array,
    walk: Array,
    noise: float,
) -> list[Any]:
    """What is sought and its covariance a tick later; the square of what the model missed, (m/s)^2.

    `pressed` (3,) is what f, r and s are multiplied with: F, -I and F_s'.
    """
    velocity, slope = foot_velocity(q_s, dq_s)
    regressor = np.column_stack([slope, np.outer(DOWN, pressed)])
    measured = velocity + slope @ value[:2]
    missed = measured - regressor @ value
    return [*updated(value, covariance, walk, regressor, measured, noise * np.eye(2)), missed @ missed]
