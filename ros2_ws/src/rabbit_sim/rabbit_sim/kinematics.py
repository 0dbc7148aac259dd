"""Where the true feet are: planar kinematics of two legs whose links may be bent.

A leg's foot is base + R(a1) l + R(a2) l with a1 = pitch + hip, a2 = a1 + knee, l = L (bend, -1) the way along a link,
R a rotation about +y, so R(a) (x, z) = (x cos a + z sin a, z cos a - x sin a) and dR(a)v/da = (z, -x) of R(a) v.
"""

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from rabbit_description.state import Array, Leg

LINK_LENGTH = 0.4  # m, thigh and shin of the URDF

Point = tuple[float, float]  # x, z; m


def _link(angle: Any, bend: Any, by: Any = math) -> tuple[Any, Any]:
    """(x, z) from a link's upper to its lower joint; of arrays of both `by` numpy."""
    c, s = by.cos(angle), by.sin(angle)
    return LINK_LENGTH * (bend * c - s), -LINK_LENGTH * (bend * s + c)


def foot(x: Any, z: Any, upper: Any, knee: Any, bend: Any, by: Any = math) -> tuple[Any, Any]:
    """Where a leg's foot is, of the base, the thigh's absolute angle and the knee's; of arrays of all `by` numpy."""
    thigh, shin = _link(upper, bend, by), _link(upper + knee, bend, by)
    return x + thigh[0] + shin[0], z + thigh[1] + shin[1]


class RabbitFeet:
    """The feet of RABBIT with links bent by `bend`; see `pinned_dynamics.Feet`."""

    links = "left_foot", "right_foot"

    def __init__(self, bend: float = 0.0) -> None:
        self._bend = bend

    def positions(self, q: Array) -> Array:
        """Centres of the feet, world, shape (2, 2): rows left, right; columns x, z; m."""
        return np.array(self.points(q.tolist()))

    def points(self, q: Sequence[float]) -> tuple[Point, Point]:
        """The same of plain numbers, for what is asked many times a tick."""
        x, z, pitch, left_hip, left_knee, right_hip, right_knee = q
        bend = self._bend
        return foot(x, z, pitch + left_hip, left_knee, bend), foot(x, z, pitch + right_hip, right_knee, bend)

    def jacobian(self, q: Array, leg: Leg) -> Array:
        """Foot velocity over `dq`, shape (2, 7): rows x, z."""
        hip = 3 + 2 * leg
        upper_angle = float(q[2] + q[hip])
        thigh, shin = _link(upper_angle, self._bend), _link(upper_angle + float(q[hip + 1]), self._bend)
        jacobian = np.zeros((2, 7))
        jacobian[0, 0] = jacobian[1, 1] = 1.0
        whole = thigh[1] + shin[1], -thigh[0] - shin[0]
        jacobian[:, 2] = jacobian[:, hip] = whole
        jacobian[:, hip + 1] = shin[1], -shin[0]
        return jacobian
