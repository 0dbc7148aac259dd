"""Rows on the stance foot's ground force, affine in mu: F = (F_N, F_T).

    C1, unilateral:     F_N >= min_normal_force
    C2, friction cone:  |F_T| <= friction_coeff F_N, two rows: +-F_T - friction_coeff F_N <= 0

The two learned pairs are the errors of F_N and of F_T: |F_T| has a kink that one affine pair cannot hold. In the
paper's literal form one pair is on the cone row of the sign that F_T has at mu = 0.
"""

from dataclasses import dataclass

import casadi as ca
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.quantity import Quantity, Rows, at_least


@dataclass(frozen=True)
class ForceRows:
    """The rows' limits as expressions: `min_normal_force`, N; `friction_coeff`, any margin taken off.

    `is_literal`: one row for the cone.
    """

    min_normal_force: ca.SX
    friction_coeff: ca.SX
    rescue_weight: ca.SX | float
    is_literal: bool = False

    def __call__(self, force: Affine) -> list[Rows]:
        """The rows of `force` = (F_N, F_T), N, affine in mu."""
        if self.is_literal:
            sign = ca.if_else(force.b[1] >= 0, 1, -1)
            names: tuple[str, ...] = ("C1", "C2")
            cone = ca.vertcat(ca.horzcat(1, 0), ca.horzcat(self.friction_coeff, -sign))
        else:
            sides = (ca.horzcat(self.friction_coeff, side) for side in (-1, 1))
            names = ("C1", "C2+", "C2-")
            cone = ca.vertcat(ca.horzcat(1, 0), *sides)
        rows = Affine(cone, ca.SX.zeros(len(names))).after(force)
        least = ca.vertcat(self.min_normal_force, ca.SX.zeros(len(names) - 1))
        return [at_least(names, rows.a, least - rows.b, self.rescue_weight)]


def contact_force(force: Affine, measured: ca.SX, rows: ForceRows | None) -> Quantity:
    """(F_N, F_T) of the model's `force` (F_T, F_N) and the sensor's `measured` one; without `rows` only estimated."""
    normal_tangential = Affine(force.a[[1, 0], :], force.b[[1, 0]])
    return Quantity(("C1", "C2"), normal_tangential, rows or (lambda value: []), sensor=measured[[1, 0]])
