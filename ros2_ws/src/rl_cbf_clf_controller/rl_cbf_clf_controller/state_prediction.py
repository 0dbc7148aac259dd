"""The state at the moment in which a tick's torque takes effect.

The problem. A torque that is computed from the state at t_k acts late: motors lag, and a bus delays. Until t_k + h the
robot still moves under the torque of the tick before. A controller that does not know this corrects errors that the
last torque has corrected already, and chatters. So the QP is solved for the state

    q+ = q + h q' + h^2 q'' / 2,    q'+ = q' + h q'',    q'' = f(q, q', u_{k-1}),

f the dynamics of the robot as identified, and h = lag T: the identification finds `lag`, the share of a change of
torque that arrives a window T late (`identification.py`).
"""

import casadi as ca
from cbf_clf_qp.functions import NumpyFunction, packed

from rl_cbf_clf_controller.identification import WINDOW
from rl_cbf_clf_controller.planar_robot import PinnedRobot

MOST = 0.012  # s, ahead


def prediction_function(window: float = WINDOW) -> NumpyFunction:
    """`x` (14,) at which the next torque takes effect, of (x now, robot's row, torque (4,), lag (1,)).

    The torque, N m, acts until then. The lag is in windows, of so many s; below 0 the state is that of now.
    Stance/swing order.
    """
    robot, lag = PinnedRobot(), ca.SX.sym("lag")
    seconds = ca.fmin(ca.fmax(lag * window, 0), MOST)
    acceleration = robot.acceleration(robot.u)
    q = robot.q + seconds * robot.dq + seconds**2 / 2 * acceleration
    inputs = {"x": ca.vertcat(robot.q, robot.dq), "robot": packed(robot.parameters), "torque": robot.u, "lag": lag}
    return NumpyFunction.of("predicted", inputs, {"x": ca.vertcat(q, robot.dq + seconds * acceleration)})
