"""Exponential control barrier functions [CBF_const] and the two stepping-stone barriers (Nguyen and Sreenath 2016).

    keep B >= 0 with relative degree 2:   B-ddot + K_b (B, B-dot) >= 0,   K_b = (p1 p2, p1 + p2), poles p1, p2 > 0

Swing foot (l, h) from the stance foot, stone [l_min, l_max]:

    B1 = R1 + l_max - |(R1 + l, h)|                         inside the circle about (-R1, 0): before the far edge
    B2 = |(l - l_min/2, h + R2)| - |(l_min/2, R2)|          outside the circle about (l_min/2, -R2): past the near edge

so at touchdown (h = 0, l > 0) both together mean l_min <= l <= l_max [eq:steprange].
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from rabbit_description.state import Array, StonePreview

from rl_cbf_clf_controller.affine import Affine
from rl_cbf_clf_controller.nominal_model import Kinematics


@dataclass(frozen=True)
class Barriers:
    """Values `B`, rates `dB` (n,), and B-ddot = `jacobian` q-ddot + `bias`: (n, 7) and (n,)."""

    B: Array
    dB: Array
    jacobian: Array
    bias: Array

    def second_derivative(self, acceleration: Affine) -> Affine:
        """B-ddot (n), affine in whatever `acceleration` is affine in."""
        return acceleration.mapped(self.jacobian, self.bias)


def ecbf_gains(poles: Sequence[float]) -> Array:
    """K_b, lowest derivative first, that puts the barrier's dynamics at -poles.

    Raises:
        ValueError: a pole is not positive, or there are not two: beyond relative degree 2 lower derivatives of B
            contain the drift already, so that one numerical differentiation no longer isolates the model error.
    """
    if len(poles) != 2 or min(poles) <= 0:
        raise ValueError(f"poles = {list(poles)}: expected two positive rates in 1/s (relative degree 2)")
    return np.poly([-p for p in poles])[:0:-1].copy()


def ecbf_bound(barriers: Barriers, K_b: Array) -> Array:
    """What B-ddot must reach, (n,): -K_b eta_b."""
    return -(K_b[0] * barriers.B + K_b[1] * barriers.dB)


def stone_barriers(feet: Kinematics, stone: StonePreview, R1: float, R2: float) -> Barriers:
    """B1 and B2 of the swing foot for a previewed stone; R1, R2 in m."""
    near = stone.l_min / 2
    outer = feet.swing + (R1, 0.0)
    inner = feet.swing + (-near, R2)
    r_outer, slope_outer, curve_outer = _distance(outer, feet.swing_rate)
    r_inner, slope_inner, curve_inner = _distance(inner, feet.swing_rate)
    gradient = np.array([-slope_outer, slope_inner])
    return Barriers(
        B=np.array([R1 + stone.l_max - r_outer, r_inner - np.hypot(near, R2)]),
        dB=gradient @ feet.swing_rate,
        jacobian=gradient @ feet.swing_jacobian,
        bias=gradient @ feet.swing_bias + np.array([-curve_outer, curve_inner]),
    )


def _distance(point: Array, velocity: Array) -> tuple[float, Array, float]:
    """|point|, its gradient (2,), and velocity' Hessian velocity."""
    radius = float(np.hypot(point[0], point[1]))
    normal = point / radius
    across = float(normal[0] * velocity[1] - normal[1] * velocity[0])
    return radius, normal, across**2 / radius
