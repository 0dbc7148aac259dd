"""Rows on the stance foot's ground force, affine in mu: F = (F_N, F_T).

    C1, unilateral:     F_N >= min_normal_force
    C2, friction cone:  |F_T| <= friction_coeff F_N, two rows: +-F_T - friction_coeff F_N <= 0

The two learned pairs are the errors of F_N and of F_T: |F_T| has a kink that one affine pair cannot hold. The paper's
literal form, one pair on the cone row of F_T's present sign, is `literal_cone_rows`.
"""

import numpy as np

from rl_cbf_clf_controller.affine import Affine
from rl_cbf_clf_controller.rows import Rows


def force_rows(force: Affine, min_normal_force: float, friction_coeff: float, slack_weight: float) -> Rows:
    """The three rows for `force` = (F_N, F_T), N; all bounds in N."""
    cone = np.array([[1.0, 0.0], [friction_coeff, -1.0], [friction_coeff, 1.0]])
    rows = force.mapped(cone)
    lower = np.array([min_normal_force, 0.0, 0.0]) - rows.b
    return Rows.at_least(("C1", "C2+", "C2-"), rows.a, lower, slack_weight)


def literal_cone_rows(force: Affine, min_normal_force: float, friction_coeff: float, slack_weight: float) -> Rows:
    """Two rows: C1, and the cone for the sign that F_T has at mu = 0."""
    sign = 1.0 if force.b[1] >= 0 else -1.0
    rows = force.mapped(np.array([[1.0, 0.0], [friction_coeff, -sign]]))
    return Rows.at_least(("C1", "C2"), rows.a, np.array([min_normal_force, 0.0]) - rows.b, slack_weight)
