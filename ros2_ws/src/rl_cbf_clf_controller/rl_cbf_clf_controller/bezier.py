"""Bézier polynomials of the phase s and their derivatives, continued to first order outside [0, 1].

b(s) = sum_k C(n, k) s^k (1 - s)^(n - k) c_k
"""

from math import comb

import numpy as np
from rabbit_description.state import Array

ROUNDING = 1e-9  # of a phase that ends at 1: still inside, where the curvature does not jump to 0


class Bezier:
    """Curves with control points `coeffs` (m, n + 1)."""

    def __init__(self, coeffs: Array) -> None:
        degree = coeffs.shape[1] - 1
        first = degree * np.diff(coeffs)
        second = (degree - 1) * np.diff(first)
        self._orders = tuple(c @ _to_powers(c.shape[1] - 1) for c in (coeffs, first, second))

    def __call__(self, s: float) -> tuple[Array, Array, Array]:
        """Value, first and second derivative in s, each (m,). Beyond either end the curve goes on along its tangent."""
        inside = min(max(s, 0.0), 1.0)
        powers = inside ** np.arange(self._orders[0].shape[1])
        value, first, second = (c @ powers[: c.shape[1]] for c in self._orders)
        if abs(inside - s) > ROUNDING:
            return value + first * (s - inside), first, np.zeros_like(second)
        return value, first, second


def _to_powers(degree: int) -> Array:
    """Matrix (n + 1, n + 1) from control points to coefficients of 1, s, s^2, ..."""
    matrix = np.zeros((degree + 1, degree + 1))
    for k in range(degree + 1):
        for j in range(degree - k + 1):
            matrix[k, k + j] = comb(degree, k) * comb(degree - k, j) * (-1) ** j
    return matrix
