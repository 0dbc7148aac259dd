"""How a path ends whose swing foot meets the ground higher, lower or later than the gait's.

A stone that lies higher or lower than the one before it is met by one leg, which is shorter at the landing: the swing
leg's for a stone above, the stance leg's for a stone below. The law of cosines gives its knee, and then its hip.

Ground that lies lower than expected is met late. A path that only went on along its end would lead the foot forward and
up again, for the body moves on. So beyond phase 1 the foot goes straight down:

    y_d(s) = path(s) + D g(s - 1),    g(x) = x - 2 f + (x + 2 f) exp(-x / f) for x > 0, else 0,    f = FADING:

g, g' and g'' begin with 0, and g' goes to 1. `descent` finds D.
"""

import casadi as ca
from cbf_clf_qp.system import solved
from rabbit_description.planar_urdf import BASE
from rabbit_description.state import Leg

from rl_cbf_clf_controller.planar_robot import PinnedRobot, rotated
from rl_cbf_clf_controller.step_paths import CONTROLLED, PHASE_ANGLE, PathExpressions

SHARES = (0.3, 1.0, 1.0)  # of the leg's change at the landing, in the last three control points
NEWTON_STEPS = 8
FOUND = 1e-4  # m and rad, that a pose may be away
DEPTH, LATE = 0.08, 0.15  # m and phase: how far a foot that finds no ground goes down, and within what


class Legs:
    """RABBIT's legs, with symbols for the lengths `joints` and `feet` of `robot_parameters`."""

    def __init__(self) -> None:
        self._robot = PinnedRobot()
        self.joints, self.feet = (self._robot.parameters[name] for name in ("joints", "feet"))

    def stance(self, q: ca.SX) -> ca.SX:
        """The stance foot (2,) in the world, m, at `q` (n,)."""
        return self._at(q, self._robot.feet[0])[0]

    def swing(self, q: ca.SX) -> list[ca.SX]:
        """The swing foot (2,) from the stance foot, m, and its Jacobian in the joints (2, m)."""
        return self._at(q, self._robot.swing, ca.jacobian(self._robot.swing, self._robot.q)[:, BASE:])

    def limbs(self, q: ca.SX, leg: Leg) -> list[ca.SX]:
        """A leg's knee from its hip and its foot from its knee, (2,), m."""
        links, structure = self._robot.links, self._robot.structure
        shin = structure.feet[leg]
        knee, hip = links[shin].origin, links[structure.parents[shin - 1]].origin
        return self._at(q, knee - hip, self._robot.feet[leg] - knee)

    def _at(self, q: ca.SX, *expressions: ca.SX) -> list[ca.SX]:
        return ca.substitute(list(expressions), [self._robot.q], [q])


def landing_at(path: PathExpressions, height: ca.SX, legs: Legs) -> PathExpressions:
    """The same path with the swing foot `height` m higher at its end, and the same pitch there."""
    is_above = height > 0
    stance, swing = (legs.limbs(path.landed, leg) for leg in Leg)
    thigh, shin = (ca.if_else(is_above, above, below) for above, below in zip(swing, stance, strict=True))
    wanted = thigh + shin + ca.vertcat(0, ca.fabs(height))
    sides, bend = ca.norm_2(thigh) * ca.norm_2(shin), turn(thigh, shin)
    cos = (ca.sumsqr(wanted) - ca.sumsqr(thigh) - ca.sumsqr(shin)) / (2 * sides)
    cos = ca.fmin(ca.fmax(cos, -1), 1)  # where no leg is so long or short
    knee = ca.atan2(ca.sign(bend) * ca.sqrt(1 - cos**2), cos) - bend
    change = ca.vertcat(turn(thigh + rotated(shin, knee), wanted), knee)
    by_leg = ca.if_else(is_above, 0, change), ca.if_else(is_above, change, 0)
    turned = ca.vertcat(ca.SX.zeros(BASE), *by_leg)
    ending = path.coeffs[:, -len(SHARES) :] + CONTROLLED @ turned @ ca.DM(SHARES).T
    return PathExpressions(
        ca.horzcat(path.coeffs[:, : -len(SHARES)], ending), path.start, path.end + PHASE_ANGLE @ turned
    )


def turn(one: ca.SX, other: ca.SX) -> ca.SX:
    """The angle about +y from the direction of a vector (x, z) to that of another, rad."""
    return ca.atan2(one[1] * other[0] - one[0] * other[1], ca.dot(one, other))


def descent(path: PathExpressions, legs: Legs) -> ca.SX:
    """By how much the desired angles (m,) change per phase beyond 1 more than along their end, rad: the swing foot then
    goes straight down, DEPTH within LATE of the phase, and the pitch stays.

    By the least change of the joints, with Newton's method. Zero where it finds no such pose.
    """
    landed, phase_angle = path.landed, PHASE_ANGLE[BASE:]
    joints = landed[BASE:]
    aim = legs.swing(landed)[0] - ca.vertcat(0, DEPTH)
    later = path.end + LATE * (path.end - path.start)
    for _ in range(NEWTON_STEPS):
        below = ca.vertcat(landed[:BASE], joints)
        swing, jacobian = legs.swing(below)
        missing = ca.vertcat(aim - swing, later - PHASE_ANGLE @ below)
        slopes = ca.vertcat(jacobian, phase_angle)
        joints = joints + slopes.T @ solved(slopes @ slopes.T, missing)
    is_found = ca.sum1(ca.fabs(missing) < FOUND) == missing.numel()
    along_the_end = (path.coeffs.shape[1] - 1) * (path.coeffs[:, -1] - path.coeffs[:, -2])
    change = CONTROLLED[:, BASE:] @ (joints - landed[BASE:])
    return ca.if_else(is_found, change / LATE - along_the_end, 0)
