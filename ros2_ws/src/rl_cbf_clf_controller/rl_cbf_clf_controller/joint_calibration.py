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

Ground that gives way moves the stance foot, too: it sinks as the load comes, and rises again. No offset explains that,
for what an offset does to the foot's velocity goes with the joints' rates throughout the step; but the least squares
make one of it all the same, of 40 to 80 mrad where a foot sinks slowly. So the offsets count only where a foot stands:
as long as the mean square of the innovations, of what the offsets of the tick before leave of the foot's velocity, is
below STILL^2. At first an innovation says more of the offsets, which are hardly known yet, than of the ground; so each
counts by the share that the offsets' covariance does not explain. With bent links on hard ground their rms is below
0.007 m/s, on ground of 1e4 N/m with 5e3 to 9e3 N s/m 0.02 m/s. From MOVING on the offsets do not count, between the two
they fade out. They do not come back in that episode. Noise of the rates is no motion: by the legs' lengths that of
pitch, hip and knee puts 1.4 sigma^2 into the foot's velocity, and over three times that is forgiven, for sigma is known
from a few ticks at first.
"""

from collections.abc import Mapping

import casadi as ca
import numpy as np
from rabbit_description.planar_urdf import BASE
from rabbit_description.state import DOF

from rl_cbf_clf_controller.least_squares import updated, within
from rl_cbf_clf_controller.planar_robot import PinnedRobot, robot_parameters

OFFSETS = np.array([[0.0, 0, 0, 1, 0, 1, 0], [0, 0, 0, 0, 1, 0, 1]]).T  # (o_h, o_k) to q
OFFSET_SPREAD = np.array([0.05, 0.01])  # rad
VELOCITY_NOISE = 0.05  # m/s
SIZE = 2
STILL, MOVING = 0.012, 0.018  # m/s; rms of the innovations, up to which the foot stands and from which on it does not
MOST = 0.05  # m/s; of one tick: a blow is no soft ground
FORGIVEN = 5.0  # of the variance of the rates' noise

# The angles are trusted, and the foot to stand. `offset_fit`: what the least squares say.
UNKNOWN = {
    **{"offsets": np.zeros(SIZE), "offset_fit": np.zeros(SIZE), "offset_covariance": np.diag(OFFSET_SPREAD**2)},
    **{"moved": np.zeros(1), "stands": np.ones(1)},
}


def calibrated(
    known: Mapping[str, ca.SX], x: ca.SX, ticks: ca.SX, noise: ca.SX, joints: ca.SX, feet: ca.SX
) -> dict[str, ca.SX]:
    """What is known a tick later, by the names of `UNKNOWN`.

    `offsets` o of hips and knees, rad, that are used; `moved`: the squares of what the offsets leave unexplained, added
    up, (m/s)^2; `stands`: from 1, where the foot does, to 0. From a corrected state `x` (14,), stance/swing order, with
    this tick so many `ticks` of a foot that should stand; `noise`: the variance of the rates' errors, (m/s)^2 and
    (rad/s)^2.
    """
    robot = PinnedRobot(parameters={**robot_parameters(), "joints": joints, "feet": feet})
    velocity = robot.rate(robot.feet[0])
    slope = ca.jacobian(velocity, robot.q[BASE : BASE + 2])  # over the stance leg's hip and knee
    velocity, slope = ca.substitute([velocity, slope], [robot.q, robot.dq], [x[:DOF], x[DOF:]])
    spread, still = VELOCITY_NOISE**2 * ca.SX.eye(2), ca.SX.zeros(SIZE, SIZE)
    measured = velocity + slope @ known["offsets"]
    fit, covariance, _ = updated(known["offset_fit"], known["offset_covariance"], still, slope, measured, spread)
    variance = ca.diag(slope @ known["offset_covariance"] @ slope.T)  # of the velocity, by the offsets' errors
    innovation = (measured - slope @ known["offset_fit"]) / ca.sqrt(1 + variance / STILL**2)
    moved = known["moved"] + ca.fmin(ca.sumsqr(innovation), MOST**2)
    square = moved / (ticks + 1) - FORGIVEN * noise
    stands = ca.fmin(known["stands"], within((MOVING**2 - square) / (MOVING**2 - STILL**2)))
    return dict(zip(UNKNOWN, (stands * fit, fit, covariance, moved, stands), strict=True))
