"""Where a foot is from the hip, by the controller's model: straight links of equal length, a small round foot.

With the world angles a = pitch + hip of the thigh and b = a + knee of the shin, the foot's centre is at
-L (sin a + sin b, cos a + cos b) from the hip. A foot of radius r that stands rolls: its centre moves r for each radian
by which the shin turns. So what stands still is the centre less (r b, 0), the foothold.
"""

from math import cos, sin

import numpy as np
from rabbit_description.state import Array, Leg

LINK_LENGTH = 0.4  # m, thigh and shin of the URDF


def foothold(pitch: float, joints: Array, leg: Leg, radius: float) -> Array:
    """From the hip, world (x, z), m; `joints` (4,) in the order of `ACTUATED`."""
    a, b = _angles(pitch, joints, leg)
    return np.array([-LINK_LENGTH * (sin(a) + sin(b)) - radius * b, -LINK_LENGTH * (cos(a) + cos(b))])


def foothold_jacobian(pitch: float, joints: Array, leg: Leg, radius: float) -> Array:
    """Its derivative over (pitch, joints), shape (2, 5), m/rad."""
    a, b = _angles(pitch, joints, leg)
    return _placed(leg, _along(a, 1.0), _along(b, 1.0) - (radius, 0.0))


def foothold_rate_by_angles(pitch: float, joints: Array, leg: Leg, pitch_rate: float, rates: Array) -> Array:
    """Derivative over (pitch, joints) of the foothold's velocity from the hip, shape (2, 5), m/s/rad."""
    a, b = _angles(pitch, joints, leg)
    da = pitch_rate + float(rates[2 * leg])
    db = da + float(rates[2 * leg + 1])
    return _placed(leg, -_across(a, da), -_across(b, db))


def _angles(pitch: float, joints: Array, leg: Leg) -> tuple[float, float]:
    a = float(pitch + joints[2 * leg])
    return a, a + float(joints[2 * leg + 1])


def _along(angle: float, rate: float) -> Array:
    """Velocity of a link's lower end, turning at `rate`, (2,)."""
    return -LINK_LENGTH * rate * np.array([cos(angle), -sin(angle)])


def _across(angle: float, rate: float) -> Array:
    return -LINK_LENGTH * rate * np.array([sin(angle), cos(angle)])


def _placed(leg: Leg, thigh: Array, shin: Array) -> Array:
    jacobian = np.zeros((2, 5))
    jacobian[:, 0] = jacobian[:, 1 + 2 * leg] = thigh + shin
    jacobian[:, 2 + 2 * leg] = shin
    return jacobian
