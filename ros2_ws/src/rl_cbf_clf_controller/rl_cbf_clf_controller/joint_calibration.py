"""Where the joints' angles are zero, found from the stance foot, which does not move.

The problem. A bent thigh and shin, or an encoder set wrongly, put knee and foot elsewhere than the measured angles
say. To first order both are an offset o of the angles: q = q_measured - (0, 0, 0, o_h, o_k, o_h, o_k). A link of
length L whose end is displaced forward by c L has turned by c, so with thigh and shin bent alike o_h = c, o_k = 0.
The stance foot stands, so its velocity by the corrected kinematics is 0 at every tick. At the present offsets,
linearised in what is left of them,

    v(q, q') = (dv/dq_h, dv/dq_k) (o - o_present)

which least squares solve (`least_squares.py`), the legs being alike. A velocity and not the foot's height: the ground
need not be level. The foot's rubber gives way as the load comes, which looks like an offset of the knee that changes
along the step; so the knee's prior is narrow.
"""

import casadi as ca
import numpy as np
from cbf_clf_qp.functions import NumpyFunction
from rabbit_description.planar_urdf import BASE
from rabbit_description.state import Array

from rl_cbf_clf_controller.least_squares import LeastSquares, updated
from rl_cbf_clf_controller.planar_robot import PinnedRobot
from rl_cbf_clf_controller.robot_numbers import RobotNumbers

OFFSETS = np.array([[0.0, 0, 0, 1, 0, 1, 0], [0, 0, 0, 0, 1, 0, 1]]).T  # (o_h, o_k) to q
OFFSET_SPREAD = np.array([0.05, 0.01])  # rad
VELOCITY_NOISE = 0.05  # m/s
SIZE = 2


class JointCalibration:
    """`value` (2,): offsets o of hips and knees, rad, of a `robot`. One object serves one thread."""

    def __init__(self, robot: RobotNumbers) -> None:
        self._joints, self._feet = robot.joints, robot.feet
        self._learned = calibration_function()
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

    def learn(self, x: Array) -> None:
        """From a corrected state (14,), stance/swing order, in which the stance foot stands."""
        fit = self._fit
        found = self._learned(x, self._joints, self._feet, fit.value, fit.covariance)
        fit.take(found.value, found.covariance)
        self._shift = OFFSETS @ fit.value


def calibration_function() -> NumpyFunction:
    """The offsets `value` (2,) and their `covariance` a tick later, of (x, joints, feet, value, covariance)."""
    robot = PinnedRobot()
    velocity = robot.rate(robot.feet[0])
    slope = ca.jacobian(velocity, robot.q[BASE : BASE + 2])  # over the stance leg's hip and knee
    value, covariance = ca.SX.sym("value", SIZE), ca.SX.sym("covariance", SIZE, SIZE)
    noise = VELOCITY_NOISE**2 * ca.SX.eye(2)
    found = updated(value, covariance, ca.SX.zeros(SIZE, SIZE), slope, velocity + slope @ value, noise)
    inputs = {"x": ca.vertcat(robot.q, robot.dq), "joints": robot.parameters["joints"]}
    inputs |= {"feet": robot.parameters["feet"], "value": value, "covariance": covariance}
    return NumpyFunction.of("calibration", inputs, {"value": found[0], "covariance": found[1]})
