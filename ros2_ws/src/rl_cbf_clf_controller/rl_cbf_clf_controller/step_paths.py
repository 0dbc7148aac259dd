"""The path of one step, found in a gait library: for the lengths before and after it, the slope, the stone's height.

A step from length A into length B begins as gait A does and ends as gait B does. Of its six control points over the
phase the first three are A's, so that it sets off from where a landing at A leaves the legs, and the last three B's, so
that it lands as B does. Its phase runs from A's start to B's end. For A = B that is the gait itself. Between the
library's lengths and slopes all of it is linear in A, in B and in the slope; what lies beyond an end counts as the end.

A stone that lies higher or lower than the one before it is met by one leg, which is shorter at the landing: the swing
leg's for a stone above, the stance leg's for a stone below.
"""

from dataclasses import dataclass
from math import ceil

import numpy as np
from rabbit_description.gait import Gait, GaitLibrary
from rabbit_description.state import DOF, JOINTS, Array, Leg

from rl_cbf_clf_controller.robot_numbers import Feet
from rl_cbf_clf_controller.virtual_constraints import RABBIT_ANGLES

STANCE_LEG, SWING_LEG = (leg.joints for leg in Leg)
SHARES = np.array([0.3, 1.0, 1.0])  # of the leg's change at the landing, in the last three control points
HEIGHT_STEP = 0.01  # m, from which Newton's method finds the next leg
NEWTON_STEPS = 4
FOUND = 1e-4  # m and rad, that a pose may be away
DEPTH, LATE = 0.08, 0.15  # m and phase: how far a foot that finds no ground goes down, and within what


@dataclass(frozen=True)
class StepPath:
    """A path of the controlled angles: `coeffs` (m, k) over the phase, rad, and the phase angles at its ends, rad."""

    coeffs: Array
    phase_angle_start: float
    phase_angle_end: float


def within(values: list[float], value: float) -> float:
    """The nearest to `value` between the ends of `values`."""
    return min(max(value, values[0]), values[-1])


def interpolated(library: GaitLibrary, length: float, slope: float = 0.0) -> StepPath:
    """The path of the periodic step of `length`, m, for ground of `slope`, degrees, linear between the gaits."""
    slope, slopes = within(library.slopes, slope), library.slopes
    if len(slopes) == 1:
        return _along(library.rows[0], library.lengths, length)
    at = _interval(slopes, slope)
    low, high = (_along(row, library.lengths, length) for row in library.rows[at - 1 : at + 1])
    return _between(low, high, (slope - slopes[at - 1]) / (slopes[at] - slopes[at - 1]))


def step_path(library: GaitLibrary, taken: float, wanted: float, slope: float = 0.0) -> StepPath:
    """The path from a step of `taken` into one of `wanted`, m, both for ground of `slope`, degrees."""
    first, last = interpolated(library, taken, slope), interpolated(library, wanted, slope)
    half = first.coeffs.shape[1] // 2
    coeffs = np.hstack([first.coeffs[:, :half], last.coeffs[:, half:]])
    return StepPath(coeffs, first.phase_angle_start, last.phase_angle_end)


def start_rate(library: GaitLibrary, length: float, slope: float = 0.0) -> float:
    """Of the phase angle after the impact of that periodic step, rad/s."""
    rates = [[float(RABBIT_ANGLES.phase_angle @ gait.dq_start) for gait in row] for row in library.rows]
    along = [np.interp(length, library.lengths, row) for row in rates]
    return float(np.interp(slope, library.slopes, along))


def speed_of(library: GaitLibrary, length: float) -> float:
    """Mean speed of the periodic step of `length` on the slope nearest to level ground, m/s."""
    speeds = [gait.step_length / gait.step_time for gait in library.level]
    return float(np.interp(length, library.lengths, speeds))


def landing_at(path: StepPath, height: float, feet: Feet) -> StepPath:
    """The same path with the swing foot `height` m higher at its end, and the same pitch there.

    The leg's new angles are found by Newton's method, from one centimetre to the next.
    """
    if height == 0:
        return path
    leg = SWING_LEG if height > 0 else STANCE_LEG
    landed = np.append(np.zeros(2), RABBIT_ANGLES.coordinates(path.coeffs[:, -1], path.phase_angle_end))
    start, foot = landed.copy(), feet(landed).swing
    for share in np.linspace(0, 1, ceil(abs(height) / HEIGHT_STEP) + 1)[1:]:
        for _ in range(NEWTON_STEPS):
            now = feet(landed)
            missing = foot + (0.0, share * height) - now.swing
            landed[leg] += np.linalg.solve(now.jacobian[:, leg], missing)
    change = RABBIT_ANGLES.controlled @ (landed - start)
    coeffs = path.coeffs.copy()
    coeffs[:, -len(SHARES) :] += np.outer(change, SHARES)
    end = path.phase_angle_end + float(RABBIT_ANGLES.phase_angle @ (landed - start))
    return StepPath(coeffs, path.phase_angle_start, end)


def descent(path: StepPath, feet: Feet) -> Array:
    """By how much the desired angles (4,) change per phase beyond 1 more than along their end, rad: the swing foot then
    goes straight down, DEPTH within LATE of the phase, and the pitch stays.

    Zero where Newton's method finds no such pose.
    """
    span = path.phase_angle_end - path.phase_angle_start
    landed = np.append(np.zeros(2), RABBIT_ANGLES.coordinates(path.coeffs[:, -1], path.phase_angle_end))
    pitch, below = landed[2], landed.copy()
    aim = feet(landed).swing - (0.0, DEPTH)
    missing = np.array([np.inf])
    for _ in range(2 * NEWTON_STEPS):
        now = feet(below)
        phase_angle = path.phase_angle_end + LATE * span - RABBIT_ANGLES.phase_angle @ below
        missing = np.array([*(aim - now.swing), phase_angle, pitch - below[2]])
        slopes = np.vstack([now.jacobian, RABBIT_ANGLES.phase_angle, np.eye(DOF)[2]])[:, 2:]
        below[2:] += np.linalg.lstsq(slopes, missing, rcond=None)[0]
    if not np.abs(missing).max() < FOUND:
        return np.zeros(JOINTS)
    along_the_end = (path.coeffs.shape[1] - 1) * (path.coeffs[:, -1] - path.coeffs[:, -2])
    return np.asarray(RABBIT_ANGLES.controlled @ (below - landed) / LATE - along_the_end)


def _along(gaits: list[Gait], lengths: list[float], length: float) -> StepPath:
    """Linear in the length between the gaits of one slope."""
    length = within(lengths, length)
    if len(gaits) == 1:
        return _as_path(gaits[0])
    at = _interval(lengths, length)
    share = (length - lengths[at - 1]) / (lengths[at] - lengths[at - 1])
    return _between(_as_path(gaits[at - 1]), _as_path(gaits[at]), share)


def _interval(values: list[float], value: float) -> int:
    """Index of the upper end of the interval of `values` that holds `value`."""
    return min(int(np.searchsorted(values, value, side="right")), len(values) - 1)


def _between(one: StepPath, other: StepPath, share: float) -> StepPath:
    return StepPath(
        (1 - share) * one.coeffs + share * other.coeffs,
        (1 - share) * one.phase_angle_start + share * other.phase_angle_start,
        (1 - share) * one.phase_angle_end + share * other.phase_angle_end,
    )


def _as_path(gait: Gait) -> StepPath:
    return StepPath(gait.coeffs, gait.phase_angle_start, gait.phase_angle_end)
