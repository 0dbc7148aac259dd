"""The robust CBF-CLF-QP: rows that hold for the worst model error within stated bounds, not for an estimate of it.

    true value = nominal value(mu) + error(mu),  error in a set;  a row holds on the set if it holds at its corners

Every mass and inertia is s times its nominal value, s in [low, high]. At a given torque the pinned robot
has q'' = drift + (input part) / s and F = s (force at no torque) + (input part), so

    V-dot, B''  = drift + input part / s,    F_N, F_T = s drift + input part,

each affine in one number, 1/s or s: the corners are s = low and s = high, and nothing is lost.
"""

from collections.abc import Callable
from typing import Any

import casadi as ca
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.quantity import Terms

from rl_cbf_clf_controller.walking import Walking

FORCES = ("C1", "C2")  # F_N, F_T


def worst_cases(w: Walking, parameters: Any) -> Callable[[Terms], list[Affine]]:
    """The corners: errors of the quantities (5,), affine in mu, at the least and the largest mass scale."""

    def errors(terms: Terms) -> list[Affine]:
        in_torque = Affine.stacked([quantity.value for quantity in terms.quantities])
        corners = []
        for scale in (w.gains["robust_scale_min"], w.gains["robust_scale_max"]):
            of_input = ca.vertcat(*(1 if name in FORCES else 1 / scale for name in terms.names))
            of_drift = ca.vertcat(*(scale if name in FORCES else 1 for name in terms.names))
            scaled = Affine(ca.diag(of_input) @ in_torque.a, of_drift * in_torque.b)
            corners.append(scaled.after(terms.control) - terms.nominal)
        return corners

    return errors
