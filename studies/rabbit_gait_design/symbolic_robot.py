"""The nominal robot as CasADi functions, in stance/swing coordinates.

With the stance foot on the ground and q = (x, z, pitch, stance hip, stance knee, swing hip, swing knee):

    M(q) q'' + h(q, q') = B u + J_stance(q)' F,      J_stance q'' + J_stance' q' = 0.

x runs along the ground and z at right angles to it. On ground that rises by the slope, gravity is turned against x.
The expressions are the controller's; masses and lengths are read from the URDF.
"""

from functools import cache

import casadi as ca
import numpy as np
from rl_cbf_clf_controller.planar_robot import PinnedRobot
from rl_cbf_clf_controller.robot_numbers import GRAVITY as UPWARDS
from rl_cbf_clf_controller.robot_numbers import read_robot

GRAVITY = float(UPWARDS[1])


def nominal(slope: float = 0.0) -> PinnedRobot:
    """Expressions of the robot; the ground rises by `slope` degrees."""
    read, rise = read_robot(), np.radians(slope)
    numbers = {name: ca.SX(getattr(read, name)) for name in ("joints", "feet", "links")}
    gravity = ca.SX(GRAVITY * np.array([np.sin(rise), np.cos(rise)]))
    return PinnedRobot(parameters={**PinnedRobot().parameters, **numbers, "gravity": gravity})


@cache
def feet() -> ca.Function:
    """`q -> stance, swing`: the feet (x, z), m."""
    robot = nominal()
    return ca.Function("feet", [robot.q], list(robot.feet))


@cache
def dynamics(slope: float = 0.0) -> tuple[ca.Function, ca.Function]:
    """`mass_matrix(q) -> (7, 7)` and `bias_forces(q, dq) -> (7,)` (Coriolis, centrifugal, gravity)."""
    robot = nominal(slope)
    mass, bias = robot.mass_and_bias
    return ca.Function("mass_matrix", [robot.q], [mass]), ca.Function("bias_forces", [robot.q, robot.dq], [bias])


@cache
def foot_motion() -> ca.Function:
    """`(q, dq, ddq) -> stance, swing position, velocity, acceleration, stance Jacobian, swing Jacobian`."""
    q, dq, ddq = (ca.SX.sym(name, 7) for name in ("q", "dq", "ddq"))
    stance, swing = feet()(q)
    outputs = [stance, swing]
    for position in (stance, swing):
        velocity = ca.jtimes(position, q, dq)
        outputs += [velocity, ca.jtimes(velocity, q, dq) + ca.jtimes(position, q, ddq)]
    outputs += [ca.jacobian(stance, q), ca.jacobian(swing, q)]
    names = ["stance", "swing", "v_stance", "a_stance", "v_swing", "a_swing", "J_stance", "J_swing"]
    return ca.Function("foot_motion", [q, dq, ddq], outputs, ["q", "dq", "ddq"], names)
