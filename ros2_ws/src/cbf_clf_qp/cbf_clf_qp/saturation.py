"""Saturation of the input as hard rows, linear in mu: |u(mu)| <= limit."""

from typing import Any

from cbf_clf_qp.affine import Affine
from cbf_clf_qp.rows import Rows


class Saturation:
    """A constraint on the input itself, of which nothing is estimated. mu that gives u = 0 is always feasible."""

    def __init__(self, limit: float) -> None:
        self._limit = limit

    def rows(self, terms: Any, control: Affine) -> list[Rows]:
        """Two-sided rows u1, u2, ... for u = `control`(mu)."""
        names = [f"u{i + 1}" for i in range(len(control.b))]
        return [Rows.between(names, control.a, -self._limit - control.b, self._limit - control.b)]
