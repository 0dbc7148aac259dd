"""Rows on the stance foot's ground force, affine in mu: F = (F_N, F_T).

    C1, unilateral:     F_N >= min_normal_force
    C2, friction cone:  |F_T| <= friction_coeff F_N, two rows: +-F_T - friction_coeff F_N <= 0

The two learned pairs are the errors of F_N and of F_T: |F_T| has a kink that one affine pair cannot hold. In the
paper's literal form one pair is on the cone row of the sign that F_T has at mu = 0.
"""

from collections.abc import Callable

import casadi as ca
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.quantity import Quantity, Rows, at_least


def force_rows(
    force: Affine, least: ca.SX, coeff: ca.SX, weight: ca.SX | float, is_literal: bool = False
) -> list[Rows]:
    """The rows of `force` = (F_N, F_T), N, affine in mu.

    `least`: of F_N, N; `coeff`: of friction, any margin taken off; `weight`: of the slacks of last resort.
    `is_literal`: one row for the cone.
    """
    if is_literal:
        sign = ca.if_else(force.b[1] >= 0, 1, -1)
        names: tuple[str, ...] = ("C1", "C2")
        cone = ca.vertcat(ca.horzcat(1, 0), ca.horzcat(coeff, -sign))
    else:
        names = ("C1", "C2+", "C2-")
        cone = ca.vertcat(ca.horzcat(1, 0), *(ca.horzcat(coeff, side) for side in (-1, 1)))
    rows = Affine(cone, ca.SX.zeros(len(names))).after(force)
    return [at_least(names, rows.a, ca.vertcat(least, ca.SX.zeros(len(names) - 1)) - rows.b, weight)]


def contact_force(force: Affine, measured: ca.SX, rows: Callable[[Affine], list[Rows]] | None) -> Quantity:
    """(F_N, F_T) of the model's `force` (F_T, F_N) and the sensor's `measured` one; without `rows` only estimated."""
    normal_tangential = Affine(force.a[[1, 0], :], force.b[[1, 0]])
    return Quantity(("C1", "C2"), normal_tangential, rows or (lambda value: []), sensor=measured[[1, 0]])
