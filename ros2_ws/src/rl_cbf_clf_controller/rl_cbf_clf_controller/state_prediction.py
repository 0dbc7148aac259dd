"""The state at the moment in which a tick's torque takes effect.

The problem. A torque that is computed from the state at t_k acts late: motors lag, and a bus delays. Until t_k + h the
robot still moves under the torque of the tick before. A controller that does not know this corrects errors that the
last torque has corrected already, and chatters. So the QP is solved for the state

    q+ = q + h q' + h^2 q'' / 2,    q'+ = q' + h q'',    q'' = f(q, q', u_{k-1}),

f the dynamics of the robot as identified, and h = lag T: the identification finds `lag`, the share of a change of
torque that arrives a tick late (`identification.py`).
"""

import numpy as np
from rabbit_description.state import TICK_SECONDS, Array

from rl_cbf_clf_controller.pinned_robot import PinnedRobot

MOST = 0.012  # s, ahead


def predicted_state(robot: PinnedRobot, q_s: Array, dq_s: Array, torque: Array, lag: float) -> tuple[Array, Array]:
    """State (7,), (7,) at which the next torque takes effect; `torque` (4,), N m, acts until then. Stance/swing order.

    `lag` is in ticks; below 0 the state is that of now.
    """
    seconds = float(np.clip(lag * TICK_SECONDS, 0.0, MOST))
    acceleration = robot.at(q_s, dq_s)[1].acceleration(torque)
    return q_s + seconds * dq_s + seconds**2 / 2 * acceleration, dq_s + seconds * acceleration
