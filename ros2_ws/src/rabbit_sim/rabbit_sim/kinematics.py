"""Where the true feet are: planar kinematics of two legs whose links may be bent and longer, and whose feet may roll.

A leg's foot is base + R(a1) l + R(a2) l with a1 = pitch + hip, a2 = a1 + knee, l = L (bend, -1) the way along a link,
R a rotation about +y, so R(a) (x, z) = (x cos a + z sin a, z cos a - x sin a) and dR(a)v/da = (z, -x) of R(a) v.

A sole with a radius larger by r than a point foot's is round about a point r above that foot along the shin. So its
lowest point, which is the foot then, lies r below the end of a shin that is shorter by r.
"""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from rabbit_description.state import DOF, Array, Leg

LINK_LENGTH = 0.4  # m, thigh and shin of the URDF

Point = tuple[float, float]  # x, z; m


class LegShape(NamedTuple):
    """The lengths of thigh and shin, m, and by which share of it the lower end is ahead; r, m."""

    thigh: float = LINK_LENGTH
    thigh_bend: float = 0.0
    shin: float = LINK_LENGTH
    shin_bend: float = 0.0
    roll: float = 0.0

    @classmethod
    def of(cls, bend: float = 0.0, stretch: float = 1.0, roll: float = 0.0) -> "LegShape":
        """The shape of links bent by `bend` and `stretch` times as long, and r."""
        length = LINK_LENGTH * stretch
        shin = length - roll
        return cls(length, bend, shin, bend * length / shin if roll else bend, roll)


def link(angle: Any, length: Any, bend: Any, by: Any = math) -> tuple[Any, Any]:
    """(x, z) from a link's upper to its lower end; of arrays of all `by` numpy."""
    c, s = by.cos(angle), by.sin(angle)
    return length * (bend * c - s), -length * (bend * s + c)


def foot(x: Any, z: Any, upper: Any, knee: Any, shape: Any, by: Any = math) -> tuple[Any, Any]:
    """Where a leg's foot is, of the base, the thigh's absolute angle, the knee's and a `LegShape`.

    Of arrays of all `by` numpy.
    """
    thigh_length, thigh_bend, shin_length, shin_bend, roll = shape
    thigh, shin = link(upper, thigh_length, thigh_bend, by), link(upper + knee, shin_length, shin_bend, by)
    return x + thigh[0] + shin[0], z + thigh[1] + shin[1] - roll


class RabbitFeet:
    """The feet of RABBIT with legs of this shape; `links` are those of its URDF in which they are, left and right.

    The jacobian is that of the point of the sole that is lowest.
    """

    links = "left_foot", "right_foot"

    def __init__(self, shape: LegShape = LegShape()) -> None:  # noqa: B008  it cannot change
        self.shape = shape

    def positions(self, q: Array) -> Array:
        """Centres of the feet, world, shape (2, 2): rows left, right; columns x, z; m."""
        return np.array(self.points(q.tolist()))

    def points(self, q: Sequence[float]) -> tuple[Point, Point]:
        """The same of plain numbers, for what is asked many times a tick."""
        x, z, pitch, left_hip, left_knee, right_hip, right_knee = q
        shape = self.shape
        return foot(x, z, pitch + left_hip, left_knee, shape), foot(x, z, pitch + right_hip, right_knee, shape)

    def jacobian(self, q: Array, leg: Leg) -> Array:
        """Foot velocity over `dq`, shape (2, 7): rows x, z."""
        hip, knee = range(DOF)[leg.joints]
        upper_angle, shape = float(q[2] + q[hip]), self.shape
        thigh = link(upper_angle, shape.thigh, shape.thigh_bend)
        shin = link(upper_angle + float(q[knee]), shape.shin, shape.shin_bend)
        below = shin[1] - shape.roll
        jacobian = np.zeros((2, DOF))
        jacobian[0, 0] = jacobian[1, 1] = 1.0
        jacobian[:, 2] = jacobian[:, hip] = thigh[1] + below, -thigh[0] - shin[0]
        jacobian[:, knee] = below, -shin[0]
        return jacobian
