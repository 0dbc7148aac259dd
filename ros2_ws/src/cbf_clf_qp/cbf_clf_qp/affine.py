"""Quantities affine in an input: value(w) = a w + b, of numbers or of expressions.

Accelerations and contact forces are affine in the input u, u is affine in the auxiliary input mu, so everything the QP
constrains is affine in mu.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca


@dataclass(frozen=True)
class Affine:
    """`value(w) = a w + b` with `a` (n, m) and `b` (n,), both arrays or both CasADi expressions."""

    a: Any
    b: Any

    @classmethod
    def identity(cls, m: int) -> "Affine":
        """The input (m,) itself, as an expression."""
        return cls(ca.SX.eye(m), ca.SX.zeros(m))

    @classmethod
    def stacked(cls, parts: Sequence["Affine"]) -> "Affine":
        """Several expressions, one below the other."""
        return cls(ca.vertcat(*(part.a for part in parts)), ca.vertcat(*(part.b for part in parts)))

    def __call__(self, w: Any) -> Any:
        """The value (n,) at `w` (m,)."""
        return self.a @ w + self.b

    def after(self, inner: "Affine") -> "Affine":
        """Composition: this of `inner`."""
        return Affine(self.a @ inner.a, self(inner.b))

    def inverse(self) -> "Affine":
        """The inverse map of a square one, as an expression."""
        a_inverse = inverse(self.a)
        return Affine(a_inverse, -a_inverse @ self.b)

    def __add__(self, other: "Affine") -> "Affine":
        return Affine(self.a + other.a, self.b + other.b)

    def __sub__(self, other: "Affine") -> "Affine":
        return Affine(self.a - other.a, self.b - other.b)


def inverse(matrix: ca.SX) -> ca.SX:
    """Inverse of a square matrix: by minors where it is small, else by QR, which takes n^3 operations and not n!."""
    n = matrix.shape[0]
    return ca.inv_minor(matrix) if n <= 4 else ca.solve(matrix, ca.SX.eye(n))
