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

from collections.abc import Mapping

import casadi as ca
import numpy as np
from rabbit_description.planar_urdf import BASE
from rabbit_description.state import DOF

from rl_cbf_clf_controller.least_squares import updated
from rl_cbf_clf_controller.planar_robot import PinnedRobot, robot_parameters

OFFSETS = np.array([[0.0, 0, 0, 1, 0, 1, 0], [0, 0, 0, 0, 1, 0, 1]]).T  # (o_h, o_k) to q
OFFSET_SPREAD = np.array([0.05, 0.01])  # rad
VELOCITY_NOISE = 0.05  # m/s
SIZE = 2


UNKNOWN = {"offsets": np.zeros(SIZE), "offset_covariance": np.diag(OFFSET_SPREAD**2)}  # the angles are trusted


def calibrated(known: Mapping[str, ca.SX], x: ca.SX, joints: ca.SX, feet: ca.SX) -> dict[str, ca.SX]:
    """The offsets o of hips and knees, rad, and their covariance a tick later, by the names of `UNKNOWN`.

    From a corrected state `x` (14,), stance/swing order, in which the stance foot stands.
    """
    robot = PinnedRobot(parameters={**robot_parameters(), "joints": joints, "feet": feet})
    velocity = robot.rate(robot.feet[0])
    slope = ca.jacobian(velocity, robot.q[BASE : BASE + 2])  # over the stance leg's hip and knee
    velocity, slope = ca.substitute([velocity, slope], [robot.q, robot.dq], [x[:DOF], x[DOF:]])
    noise, still = VELOCITY_NOISE**2 * ca.SX.eye(2), ca.SX.zeros(SIZE, SIZE)
    measured = velocity + slope @ known["offsets"]
    found = updated(known["offsets"], known["offset_covariance"], still, slope, measured, noise)
    return dict(zip(UNKNOWN, found, strict=False))
