"""Where the robot's joints are, for pictures; vectorised over ticks. R(a) (0, -1) = (-sin a, -cos a) about +y."""

import numpy as np
from rabbit_description.state import Array, Leg

LEG_LINK = 0.4  # m, thigh and shin
TORSO = 0.63  # m


def leg_points(q: Array, leg: Leg, bend: float = 0.0) -> Array:
    """Hip, knee and foot of a leg, world x and z, for `q` (n, 7): shape (n, 3, 2), m; links bent by `bend`."""
    hip_angle = q[:, 2] + q[:, 3 + 2 * leg]
    hip = q[:, :2]
    knee = hip + _link(hip_angle, bend)
    return np.stack([hip, knee, knee + _link(hip_angle + q[:, 4 + 2 * leg], bend)], axis=1)


def torso_points(q: Array) -> Array:
    """Hip and the torso's upper end: shape (n, 2, 2), m."""
    hip, pitch = q[:, :2], q[:, 2]
    return np.stack([hip, hip + TORSO * np.stack([np.sin(pitch), np.cos(pitch)], axis=1)], axis=1)


def feet(q: Array, bend: float = 0.0) -> Array:
    """Both feet: shape (n, 2, 2), rows left, right, m."""
    return np.stack([leg_points(q, leg, bend)[:, 2] for leg in Leg], axis=1)


def _link(angle: Array, bend: float) -> Array:
    sine, cosine = np.sin(angle), np.cos(angle)
    return LEG_LINK * np.stack([bend * cosine - sine, -bend * sine - cosine], axis=1)
