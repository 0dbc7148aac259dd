"""Where the joints' angles are zero, found from the stance foot, which does not move.

The problem. A bent thigh and shin, or an encoder set wrongly, put knee and foot elsewhere than the measured angles
say. To first order both are an offset o of the angles: q = q_measured - (0, 0, 0, o_h, o_k, o_h, o_k). A link of
length L whose end is displaced forward by c L has turned by c, so with thigh and shin bent alike o_h = c, o_k = 0.
The stance foot stands, so its velocity by the corrected kinematics is 0 at every tick. At the present offsets,
linearised in what is left of them,

    v(q, q') = (dv/dq_h, dv/dq_k) (o - o_present)

which least squares solve (`least_squares.py`), the legs being alike. A velocity and not the foot's height: the ground
need not be level. The foot's rubber gives way as the load comes, which looks like an offset of the knee that changes
along the step; so of the knee little is believed.
"""

from typing import Any

import numpy as np
import pinocchio as pin
from cbf_clf_qp.tracing import Traced
from rabbit_description.state import Array

from rl_cbf_clf_controller.generated_model import make_foot_velocity
from rl_cbf_clf_controller.least_squares import LeastSquares, updated

OFFSETS = np.array([[0.0, 0, 0, 1, 0, 1, 0], [0, 0, 0, 0, 1, 0, 1]]).T  # (o_h, o_k) to q
OFFSET_SPREAD = np.array([0.05, 0.01])  # rad
VELOCITY_NOISE = 0.05  # m/s
SIZE = 2


class JointCalibration:
    """`value` (2,): offsets o of hips and knees, rad."""

    def __init__(self, model: pin.Model) -> None:
        self.foot_velocity = make_foot_velocity(model)
        self._learned = traced_calibration.twin()
        self.reset()
        self.learn(np.zeros(model.nq), np.zeros(model.nv))  # traced now, not in the first tick that counts
        self.reset()

    @property
    def value(self) -> Array:
        return self._fit.value

    def reset(self) -> None:
        """Trust the angles again."""
        self._fit = LeastSquares(np.zeros(SIZE), np.diag(OFFSET_SPREAD**2), np.zeros((SIZE, SIZE)))
        self._shift = np.zeros(len(OFFSETS))

    def corrected(self, q: Array) -> Array:
        """q (7,) from measured angles; in either order of the legs."""
        return q - self._shift

    def learn(self, q_s: Array, dq_s: Array) -> None:
        """From a corrected state (7,), stance/swing order, in which the stance foot stands."""
        fit = self._fit
        fit.take(*self._learned(self.foot_velocity, q_s, dq_s, fit.value, fit.covariance, fit.walk))
        self._shift = OFFSETS @ fit.value


@Traced
def traced_calibration(
    foot_velocity: Any, q_s: Array, dq_s: Array, value: Array, covariance: Array, walk: Array
) -> tuple[Array, Array]:
    """The offsets and their covariance a tick later."""
    velocity, slope = foot_velocity(q_s, dq_s)
    return updated(value, covariance, walk, slope, velocity + slope @ value, VELOCITY_NOISE**2 * np.eye(2))
