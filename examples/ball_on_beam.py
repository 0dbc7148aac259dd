"""A ball rolls on a beam that a motor turns: a barrier of relative degree 4 keeps it from the beam's end.

    state x = (r, theta, r', theta'): the ball's place from the pivot, the beam's angle in its frame (up on the right)
    r''     = -rolling g sin(theta + tilt),   rolling = 1 / (1 + I / (m R^2)): 5/7 of a solid ball, 3/5 of a hollow one
    theta'' = torque / INERTIA
    CLF:      y = r - target, relative degree 4; a soft row
    barrier:  B = LIMIT - r >= 0, relative degree 4; a row with a slack of last resort

The model believes in a solid ball and a level frame. One difference does not measure B'''' (Remark 3), so nothing can
be learned here: `nominal` passes LIMIT, `oracle`, which knows the true ball and frame, stops before it.
"""

from collections.abc import Mapping

import casadi as ca
import numpy as np
from cbf_clf_qp import Barrier, Clf, System
from rabbit_description.task import ControlTask, Disc, Line, Shape

LIMIT, LENGTH, RADIUS = 0.4, 0.5, 0.03  # m: of r, of half the beam, of the ball
GRAVITY, INERTIA = 9.81, 0.02  # m/s^2, kg m^2
POLES = (6.0, 6.0, 6.0, 6.0)  # 1/s

r, theta, dr, dtheta, torque = (ca.SX.sym(name) for name in ("r", "theta", "dr", "dtheta", "torque"))
rolling, tilt, target = p = [ca.SX.sym(name) for name in ("rolling", "tilt", "target")]
x_dot = ca.vertcat(dr, dtheta, -rolling * GRAVITY * ca.sin(theta + tilt), torque / INERTIA)


def draw(x: np.ndarray, p: Mapping[str, float]) -> list[Shape]:
    """The beam and the ball on it."""
    along, up = np.array([np.cos(x[1]), np.sin(x[1])]), np.array([-np.sin(x[1]), np.cos(x[1])])
    return [Line(np.array([-LENGTH * along, LENGTH * along])), Disc(x[0] * along + RADIUS * up, RADIUS)]


TASK = ControlTask(
    "ball_on_beam",
    System(ca.vertcat(r, theta, dr, dtheta), torque, x_dot, p),
    [Clf(r - target, gains=(1.0, 4.0, 6.0, 4.0)), Barrier("end", LIMIT - r, POLES)],
    nominal={"rolling": 5 / 7, "tilt": 0.0},
    true={"rolling": 3 / 5, "tilt": -0.05},
    start=((-0.3, -0.02, 0, 0), (-0.1, 0.02, 0, 0)),
    commands=lambda rng: lambda t: {"target": 0.5},
    limit=5.0,
    tolerance=0.001,
    failed=ca.fabs(r) - LENGTH,
    coordinates=("r", "theta"),
    inputs=("torque",),
    draw=draw,
)
