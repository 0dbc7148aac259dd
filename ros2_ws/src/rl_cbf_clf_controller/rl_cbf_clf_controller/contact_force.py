"""Rows on the stance foot's ground force, affine in mu: F = (F_N, F_T).

    C1, unilateral:     F_N >= min_normal_force
    C2, friction cone:  |F_T| <= friction_coeff F_N, two rows: +-F_T - friction_coeff F_N <= 0

The two learned pairs are the errors of F_N and of F_T: |F_T| has a kink that one affine pair cannot hold. The paper's
literal form, one pair on the cone row of F_T's present sign, is `literal_cone_rows`.
"""

from dataclasses import dataclass

import numpy as np
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.rows import Rows
from cbf_clf_qp.tick import Terms
from rabbit_description.state import Array

from rl_cbf_clf_controller.pinned_robot import PinnedDynamics
from rl_cbf_clf_controller.scene import Scene


@dataclass(frozen=True)
class ContactForce:
    """(F_N, F_T), N, as a quantity. Without `has_rows` they are estimated and not constrained.

    `min_normal_force` in N; `friction_coeff` is that of the rows, any margin taken off; `is_literal`: one row for the
    cone, for the sign that F_T has at mu = 0.
    """

    min_normal_force: float
    friction_coeff: float
    rescue_weight: float
    is_literal: bool = False
    has_rows: bool = True

    names = ("C1", "C2")

    def predict(self, scene: Scene, dynamics: PinnedDynamics) -> Affine:
        """The force, affine in the torque."""
        return dynamics.normal_tangential

    def measure(self, before: Scene, after: Scene, seconds: float) -> Array:
        """The force sensor's, averaged over the tick."""
        return after.force[0, ::-1]

    def rows(self, scene: Scene, value: Affine) -> list[Rows]:
        """C1 and the cone, if the force is `value`, affine in mu."""
        if not self.has_rows:
            return []
        build = literal_cone_rows if self.is_literal else force_rows
        return [build(value, self.min_normal_force, self.friction_coeff, self.rescue_weight).normalised()]


class NominalForce:
    """The same rows as a constraint, on the force that the nominal model says."""

    def __init__(self, force: ContactForce) -> None:
        self._force = force

    def rows(self, terms: Terms[Scene], control: Affine) -> list[Rows]:
        """At u = `control`(mu)."""
        return self._force.rows(terms.scene, self._force.predict(terms.scene, terms.dynamics).after(control))


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
