"""Outputs y = H q - desired(phase), in stance/swing coordinates, as CasADi expressions.

    phase s = (c' q - start) / (end - start)
    y = H q - d_0,   d_0' = d_1 s',   d_1' = d_2 s',     d_0, d_1, d_2: desired(s) and its two derivatives in s

H q are m controlled angles, linear in the coordinates. RABBIT's are its four joints, and its phase angle c' q is
pitch + stance hip + stance knee / 2. For a tick the d_i are parameters that move with the phase. `desired` gives them:

    desired(s) = path(s) + correction((s - begin) / width) + descent g(s - 1)

Path and correction are polynomials, continued outside [0, 1] so that their curvature fades: p''(s) = p''(end)
exp(-|s - end| / FADING). Constant, it would lead a late foot far away; none at all, it would jump at the end, and with
it y'' and the error of every estimate. `step_begin.py` has what the correction is for, `step_landing.py` descent and g.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from math import comb

import casadi as ca
import numpy as np
from rabbit_description.gait import Gait
from rabbit_description.planar_urdf import BASE
from rabbit_description.state import DOF, Array

FADING = 0.04  # of the phase, in which the curvature falls to 1/e beyond an end
POWERS, CORRECTION_POWERS = 8, 5  # coefficients of the polynomials, the highest ones zero where there are fewer
Orders = tuple[ca.SX, ca.SX, ca.SX]  # a function and its two derivatives


@dataclass(frozen=True)
class Angles:
    """What is controlled and what stands for time: H = `controlled` (m, n), c = `phase_angle` (n,)."""

    controlled: Array
    phase_angle: Array

    def coordinates(self, controlled: Array, phase_angle: float) -> Array:
        """Pitch and joints (n - 2,) at these angles, or their rates at these rates; needs m = n - 3."""
        matrix = np.vstack([self.controlled, self.phase_angle])[:, 2:]
        return np.linalg.solve(matrix, np.append(controlled, phase_angle))


RABBIT_ANGLES = Angles(np.eye(DOF)[BASE:], np.array([0.0, 0.0, 1.0, 1.0, 0.5, 0.0, 0.0]))


@dataclass(frozen=True)
class StepPath:
    """A path of the controlled angles: `coeffs` (m, k) over the phase, rad, and the phase angles at its ends, rad."""

    coeffs: Array
    phase_angle_start: float
    phase_angle_end: float


class OutputExpressions:
    """The outputs of coordinates with the symbols `q` and `dq` (n,), and the `parameters` that they add to a system.

    `path`: the symbols of a path, see `path_symbols`.
    """

    def __init__(self, q: ca.SX, dq: ca.SX, angles: Angles = RABBIT_ANGLES) -> None:
        m = len(angles.controlled)
        value, slope, curvature = (ca.SX.sym(f"desired_{k}", m) for k in range(3))
        scale = ca.SX.sym("phase_scale", 2)  # 1 / (end - start), start / (end - start)
        self.phase = scale[0] * ca.dot(ca.DM(angles.phase_angle), q) - scale[1]
        self.phase_rate = ca.jtimes(self.phase, q, dq)
        self.y = ca.DM(angles.controlled) @ q - value
        self.path = path_symbols(m)
        self.parameters = {"desired_0": value, "desired_1": slope, "desired_2": curvature, "phase_scale": scale}
        self.rates = {"desired_0": slope * self.phase_rate, "desired_1": curvature * self.phase_rate}

    def along_path(self, expressions: list[ca.SX]) -> list[ca.SX]:
        """These, where it is the `path` that says what is desired at this phase."""
        wanted = [self.parameters[f"desired_{k}"] for k in range(3)]
        return ca.substitute(expressions, wanted, list(desired(self.phase, self.path)))


def desired(phase: ca.SX, path: Mapping[str, ca.SX]) -> Orders:
    """desired(phase) (m,) and its two derivatives, with the symbols of `path_symbols`."""
    begin, width = path["correction_span"][0], path["correction_span"][1]
    along = continued(path["powers"], phase)
    corrected = continued(path["correction"], (phase - begin) / width)
    lowered = gradual_line(phase - 1)
    value, slope, curvature = (along[k] + corrected[k] / width**k + path["descent"] * lowered[k] for k in range(3))
    return value, slope, curvature


def path_symbols(outputs: int) -> dict[str, ca.SX]:
    """New symbols for the numbers of a path of m `outputs`: coefficients of 1, s, s^2, ...; see `path_row`."""
    shapes = {"powers": (outputs, POWERS), "correction": (outputs, CORRECTION_POWERS)}
    shapes |= {"correction_span": (2, 1), "descent": (outputs, 1)}
    return {name: ca.SX.sym(name, *shape) for name, shape in shapes.items()}


def path_row(path: StepPath | Gait) -> Array:
    """The numbers of a path, with no correction and no descent, in the order of `path_symbols`."""
    m, points = path.coeffs.shape
    powers = np.pad(path.coeffs @ power_matrix(points), ((0, 0), (0, POWERS - points)))
    return np.concatenate([powers.ravel(), np.zeros(m * CORRECTION_POWERS), [0.0, 1.0], np.zeros(m)])


def path_scale(path: StepPath | Gait) -> Array:
    """What turns a phase angle into a phase of the path: `phase_scale` of `OutputExpressions`, (2,)."""
    span = path.phase_angle_end - path.phase_angle_start
    return np.array([1 / span, path.phase_angle_start / span])


def continued(coefficients: ca.SX, s: ca.SX) -> Orders:
    """Polynomials (m,) with `coefficients` (m, k) of 1, s, ..., continued outside [0, 1], and two derivatives in s."""
    inside, at = ca.fmin(ca.fmax(s, 0), 1), ca.SX.sym("at")
    powers = [ca.SX(1)]
    for _ in range(coefficients.shape[1] - 1):
        powers.append(powers[-1] * at)
    value = coefficients @ ca.vertcat(*powers)
    first = ca.jacobian(value, at)
    value, first, second = ca.substitute([value, first, ca.jacobian(first, at)], [at], [inside])
    beyond = s - inside
    left = ca.exp(-ca.fabs(beyond) / FADING)
    turned = FADING * (1 - left) * ca.sign(beyond)  # the integral of what is left of the curvature
    bent = FADING * (ca.fabs(beyond) - ca.fabs(turned))  # and the integral of that
    return value + first * beyond + second * bent, first + second * turned, second * left


def gradual_line(x: ca.SX) -> Orders:
    """g of `step_landing.py`: a line of slope 1 that begins gradually at x = 0; and two derivatives."""
    after = ca.fmax(x, 0) / FADING
    left = ca.exp(-after)
    return FADING * (after - 2 + (after + 2) * left), 1 - (1 + after) * left, after * left / FADING


def power_matrix(points: int) -> Array:
    """By which n + 1 control points c_k become the coefficients of 1, s, s^2, ... in sum_k C(n, k) s^k (1 - s)^(n - k)
    c_k."""
    matrix, degree = np.zeros((points, points)), points - 1
    for k in range(points):
        for j in range(points - k):
            matrix[k, k + j] = comb(degree, k) * comb(degree - k, j) * (-1) ** j
    return matrix
