"""Bézier polynomials of the phase s and their derivatives, continued outside [0, 1].

    b(s) = sum_k C(n, k) s^k (1 - s)^(n - k) c_k

Beyond an end the curvature fades, b''(s) = b''(end) exp(-|s - end| / FADING). Constant, it would lead a late foot far
away; none at all, it would jump at the end, and with it y'' and the error of every estimate.
"""

from math import comb

import numpy as np
from rabbit_description.state import Array

FADING = 0.04  # of the phase, in which the curvature falls to 1/e beyond an end


class Bezier:
    """Curves with control points `coeffs` (m, n + 1)."""

    def __init__(self, coeffs: Array) -> None:
        degree = coeffs.shape[1] - 1
        first = degree * np.diff(coeffs)
        second = (degree - 1) * np.diff(first)
        self._orders = tuple(c @ _to_powers(c.shape[1] - 1) for c in (coeffs, first, second))

    @property
    def powers(self) -> Array:
        """Coefficients (m, n + 1) of 1, s, s^2, ..."""
        return self._orders[0]

    def __call__(self, s: float) -> tuple[Array, Array, Array]:
        """Value, first and second derivative in s, each (m,)."""
        inside = min(max(s, 0.0), 1.0)
        powers = inside ** np.arange(self._orders[0].shape[1])
        value, first, second = (c @ powers[: c.shape[1]] for c in self._orders)
        beyond = s - inside
        left = np.exp(-abs(beyond) / FADING)
        turned = FADING * (1 - left) * np.sign(beyond)  # the integral of what is left of the curvature
        bent = FADING * (abs(beyond) - abs(turned))  # and the integral of that
        return value + first * beyond + second * bent, first + second * turned, second * left


def _to_powers(degree: int) -> Array:
    """Matrix (n + 1, n + 1) from control points to coefficients of 1, s, s^2, ..."""
    matrix = np.zeros((degree + 1, degree + 1))
    for k in range(degree + 1):
        for j in range(degree - k + 1):
            matrix[k, k + j] = comb(degree, k) * comb(degree - k, j) * (-1) ** j
    return matrix
