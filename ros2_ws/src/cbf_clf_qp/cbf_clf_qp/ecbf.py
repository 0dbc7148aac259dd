"""Exponential control barrier functions of relative degree 2 [CBF_const].

    keep B >= 0:   B-ddot + K_b (B, B-dot) >= 0,   K_b = (p1 p2, p1 + p2), poles p1, p2 > 0

The condition promises B >= 0 only where it begins with B >= 0 and B-dot + p1 B >= 0.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cbf_clf_qp.affine import Affine, Array
from cbf_clf_qp.rows import Rows


@dataclass(frozen=True)
class Barriers:
    """Values `B`, rates `dB` (n,), and B-ddot = `jacobian` q-ddot + `bias`: (n, coordinates) and (n,)."""

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


class Ecbf:
    """Barriers as a quantity, B-ddot. A barrier of your own is a subclass with `names` and `barriers`.

    Args:
        poles: p1, p2, 1/s.
        rescue_weight: of the slack of last resort on each row.
    """

    names: tuple[str, ...]

    def __init__(self, poles: Sequence[float], rescue_weight: float) -> None:
        self._K_b = ecbf_gains(poles)
        self._rescue_weight = rescue_weight

    def barriers(self, scene: Any) -> Barriers:
        """The barriers at a state."""
        raise NotImplementedError

    def predict(self, scene: Any, dynamics: Any) -> Affine:
        """B-ddot (n), affine in the input, under `dynamics`, which have the `acceleration` of the coordinates."""
        return self.barriers(scene).second_derivative(dynamics.acceleration)

    def measure(self, before: Any, after: Any, seconds: float) -> Array:
        """B-ddot (n): the difference of the barriers' rates."""
        difference: Array = (self.barriers(after).dB - self.barriers(before).dB) / seconds
        return difference

    def rows(self, scene: Any, value: Affine) -> list[Rows]:
        """A row for each barrier if B-ddot is `value`, affine in mu."""
        lower = ecbf_bound(self.barriers(scene), self._K_b) - value.b
        return [Rows.at_least(self.names, value.a, lower, self._rescue_weight).normalised()]
