"""The path of one step, found in a gait library: for the lengths before and after it, and the slope.

A step from length A into length B begins as gait A does and ends as gait B does. Of its six control points over the
phase the first three are A's, so that it sets off from where a landing at A leaves the legs, and the last three B's, so
that it lands as B does. Its phase runs from A's start to B's end. For A = B that is the gait itself. Between the
library's lengths and slopes all of it is linear in A, in B and in the slope; what lies beyond an end counts as the end.

The gaits' numbers are inputs: functions of one library serve another of its shape. A single gait is a library of one.
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np
from cbf_clf_qp.functions import packed
from rabbit_description.gait import GaitLibrary, Gaits
from rabbit_description.planar_urdf import SLIDES
from rabbit_description.state import JOINTS, Array

from rl_cbf_clf_controller.speed_regulation import clipped
from rl_cbf_clf_controller.virtual_constraints import CORRECTION_POWERS, POWERS, RABBIT_ANGLES, power_matrix

PHASE_ANGLE = ca.DM(RABBIT_ANGLES.phase_angle).T
CONTROLLED = ca.DM(RABBIT_ANGLES.controlled)
TO_COORDINATES = ca.inv(ca.vertcat(CONTROLLED, PHASE_ANGLE)[:, SLIDES:])


@dataclass(frozen=True)
class PathExpressions:
    """A `StepPath` as expressions."""

    coeffs: ca.SX
    start: ca.SX
    end: ca.SX

    @property
    def scale(self) -> ca.SX:
        """`phase_scale` of `OutputExpressions`, (2,)."""
        span = self.end - self.start
        return ca.vertcat(1 / span, self.start / span)

    @property
    def powers(self) -> ca.SX:
        """Coefficients (m, POWERS) of 1, s, s^2, ..."""
        m, points = self.coeffs.shape
        return ca.horzcat(self.coeffs @ ca.sparsify(power_matrix(points)), ca.SX.zeros(m, POWERS - points))

    @property
    def landed(self) -> ca.SX:
        """Coordinates (n,) at its end, with the base at the origin."""
        return ca.vertcat(ca.SX.zeros(SLIDES), TO_COORDINATES @ ca.vertcat(self.coeffs[:, -1], self.end))

    def row(self, correction: ca.SX | None = None, span: ca.SX | None = None, descent: ca.SX | None = None) -> ca.SX:
        """The path's numbers in the order of `path_symbols`; the `correction` in powers (m, CORRECTION_POWERS)."""
        m = self.coeffs.shape[0]
        numbers = {"powers": self.powers, "correction": ca.SX.zeros(m, CORRECTION_POWERS)}
        numbers |= {"correction_span": ca.SX([0, 1]), "descent": ca.SX.zeros(m)}
        changed = {"correction": correction, "correction_span": span, "descent": descent}
        return packed(numbers | {name: value for name, value in changed.items() if value is not None})


@dataclass(frozen=True)
class Shape:
    """The shape of a gait or a library: its step `lengths` and `slopes`, and control `points` over the phase."""

    lengths: int
    slopes: int
    points: int

    @classmethod
    def of(cls, gaits: Gaits) -> "Shape":
        """The shape of these gaits."""
        library = as_library(gaits)
        return cls(len(library.lengths), len(library.slopes), library.gaits[0].coeffs.shape[1])

    @property
    def is_single(self) -> bool:
        """Whether there is nothing to choose."""
        return self.lengths * self.slopes == 1


class GaitExpressions:
    """The gaits of a shape, with `symbols` for their numbers.

    `start_length`, m, with which an episode begins; `lengths` (n,), m, and `slopes` (r,), degrees; `speeds` (n,), m/s,
    for the slope nearest to level ground; `gaits` (r n, m k + 3), a row for each: its control points, rad, the phase
    angles at both ends, rad, and the phase angle's rate after the impact, rad/s.
    """

    def __init__(self, shape: Shape) -> None:
        n, r, self._points = shape.lengths, shape.slopes, shape.points
        sizes = {"start_length": (1, 1), "lengths": (n, 1), "slopes": (r, 1), "speeds": (n, 1)}
        sizes |= {"gaits": (r * n, JOINTS * shape.points + 3)}
        self.symbols = {name: ca.SX.sym(name, *size) for name, size in sizes.items()}
        self.start_length, self.lengths, self.slopes, self._speeds, gaits = self.symbols.values()
        self._rows = ca.vertsplit(gaits, n)

    @property
    def slope_range(self) -> tuple[ca.SX, ca.SX]:
        """The least and the largest slope, degrees."""
        return self.slopes[0], self.slopes[-1]

    def within(self, length: ca.SX) -> ca.SX:
        """The nearest step length that there is a gait for, m."""
        return clipped(length, self.lengths[0], self.lengths[-1])

    def path(self, taken: ca.SX, wanted: ca.SX, slope: ca.SX) -> PathExpressions:
        """The path from a step of `taken` into one of `wanted`, m, both for ground of `slope`, degrees."""
        first, last = self._at(taken, slope), self._at(wanted, slope)
        half, shape = self._points // 2, (self._points, JOINTS)
        begins, ends = (ca.reshape(numbers[: JOINTS * self._points], *shape).T for numbers in (first, last))
        return PathExpressions(ca.horzcat(begins[:, :half], ends[:, half:]), first[-3], last[-2])

    def start_rate(self, length: ca.SX, slope: ca.SX) -> ca.SX:
        """The rate of the phase angle after the impact of that periodic step, rad/s."""
        return self._at(length, slope)[-1]

    def speed(self, length: ca.SX) -> ca.SX:
        """Mean speed of the periodic step of `length` on the slope nearest to level ground, m/s."""
        return ca.dot(self._speeds, shares(self.lengths, length))

    def _at(self, length: ca.SX, slope: ca.SX) -> ca.SX:
        """The numbers of that periodic step."""
        along, across = shares(self.lengths, length), shares(self.slopes, slope)
        return ca.horzcat(*(row.T @ along for row in self._rows)) @ across


def as_library(gaits: Gaits) -> GaitLibrary:
    """A single gait as a library of one."""
    if isinstance(gaits, GaitLibrary):
        return gaits
    return GaitLibrary(name=gaits.name, start_length=gaits.step_length, gaits=[gaits])


def gait_row(gaits: Gaits) -> Array:
    """The numbers of a gait or library, in the order of the symbols of `GaitExpressions`."""
    library = as_library(gaits)
    speeds = [gait.step_length / gait.step_time for gait in library.level]
    numbers = [library.start_length, *library.lengths, *library.slopes, *speeds]
    for gait in library.gaits:
        rate = float(RABBIT_ANGLES.phase_angle @ gait.dq_start)
        numbers += [*gait.coeffs.ravel(), gait.phase_angle_start, gait.phase_angle_end, rate]
    return np.array(numbers)


def shares(places: ca.SX, value: ca.SX) -> ca.SX:
    """The shares, at `value`, of what lies at increasing `places` (n,): linear between two, beyond an end the end's."""
    if places.numel() == 1:
        return ca.SX(1)
    passed = clipped((value - places[:-1]) / (places[1:] - places[:-1]), 0, 1)
    return ca.vertcat(1, passed) - ca.vertcat(passed, 0)
