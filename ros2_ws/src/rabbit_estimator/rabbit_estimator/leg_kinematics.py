"""Where a foot is from the hip, by the controller's model: straight links of equal length, a small round foot.

With the world angles a = pitch + hip of the thigh and b = a + knee of the shin, the foot's centre is at
-L (sin a + sin b, cos a + cos b) from the hip. A foot of radius r that stands rolls: its centre moves r for each radian
by which the shin turns. So what stands still is the centre less (r b, 0), the foothold.
"""

from typing import Any

import casadi as ca
from rabbit_description.state import JOINTS

LINK_LENGTH = 0.4  # m, thigh and shin of the URDF


def foothold(pitch: Any, joints: Any, leg: Any, radius: Any) -> Any:
    """The foothold from the hip, world (x, z), m; `joints` (4,) in the order of `ACTUATED`. Numbers or expressions."""
    a = pitch + ca.if_else(leg, joints[2], joints[0])
    b = a + ca.if_else(leg, joints[3], joints[1])
    return -LINK_LENGTH * ca.vertcat(ca.sin(a) + ca.sin(b), ca.cos(a) + ca.cos(b)) - ca.vertcat(radius * b, 0)


def foothold_rate(pitch: Any, joints: Any, leg: Any, radius: Any, pitch_rate: Any, rates: Any) -> Any:
    """The foothold's velocity from the hip's, m/s, where pitch and joints turn at these rates."""
    angles = ca.SX.sym("angles", 1 + JOINTS)
    rate = ca.jtimes(foothold(angles[0], angles[1:], leg, radius), angles, ca.vertcat(pitch_rate, rates))
    return ca.substitute(rate, angles, ca.vertcat(pitch, joints))
