"""Quantities affine in an input: value(w) = a w + b.

Accelerations and contact forces are affine in the torque u, u is affine in the auxiliary input mu, so everything the
QP constrains is affine in mu. One class carries all of them, nominal, estimated or true.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from cbf_clf_qp.symbols import inverse

Array = NDArray[Any]  # float64 unless said otherwise


@dataclass(frozen=True)
class Affine:
    """`value(w) = a w + b` with `a` (n, m) and `b` (n,)."""

    a: Array
    b: Array

    @classmethod
    def zero(cls, n: int, m: int) -> "Affine":
        """0 (n,) whatever the input (m,)."""
        return cls(np.zeros((n, m)), np.zeros(n))

    @classmethod
    def identity(cls, m: int) -> "Affine":
        """The input (m,) itself."""
        return cls(np.eye(m), np.zeros(m))

    @classmethod
    def stacked(cls, parts: Sequence["Affine"]) -> "Affine":
        """Several, one below the other."""
        return cls(np.concatenate([part.a for part in parts]), np.concatenate([part.b for part in parts]))

    def __call__(self, w: Array) -> Array:
        """The value at `w` (m,), shape (n,)."""
        return self.a @ w + self.b

    def after(self, inner: "Affine") -> "Affine":
        """Composition: this of `inner`."""
        return Affine(self.a @ inner.a, self.a @ inner.b + self.b)

    def inverse(self) -> "Affine":
        """The inverse map of a square one; raises numpy.linalg.LinAlgError where `a` is singular."""
        a_inverse = inverse(self.a)
        return Affine(a_inverse, -a_inverse @ self.b)

    def mapped(self, matrix: Array, offset: Array | float = 0.0) -> "Affine":
        """`matrix value(w) + offset`."""
        return Affine(matrix @ self.a, matrix @ self.b + offset)

    def __add__(self, other: "Affine") -> "Affine":
        return Affine(self.a + other.a, self.b + other.b)

    def __sub__(self, other: "Affine") -> "Affine":
        return Affine(self.a - other.a, self.b - other.b)
