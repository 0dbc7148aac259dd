"""The robust CBF-CLF-QP: rows that hold for the worst model error within stated bounds, not for an estimate of it.

    true value = nominal value(mu) + error(mu),  error in a set;  a row holds on the set if it holds at its corners

`mass_scale`: every mass and inertia is s times its nominal value, s in [low, high]. At a given torque the pinned robot
has q'' = drift + (input part) / s and F = s (force at no torque) + (input part), so

    V-dot, B''  = drift + input part / s,    F_N, F_T = s drift + input part,

each affine in one number, 1/s or s: the corners are s = low and s = high, and nothing is lost.

`norm`: the source's form (Nguyen and Sreenath, Robust safety-critical control for dynamic robotics), with
y'' = mu + Delta_1 + Delta_2 mu, |Delta_1| <= offset, and Delta_2 mu = r mu with |r| <= slope; so the error is

    of V-dot  within +-slope LgV mu + |LgV| offset        its row bounds V-dot from above: that end of Delta_1 is worst
    of B''    within +-barrier_slope mu_b - barrier_offset,   mu_b the virtual input, B'' of the nominal model

and both corners +- are rows. The forces are left nominal.
"""

from collections.abc import Callable
from typing import Any

import casadi as ca
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.terms import Terms

from rl_cbf_clf_controller.walking import Walking

FORCES = (3, 4)  # of the quantities V, B1, B2, F_N, F_T


def worst_cases(w: Walking, parameters: Any) -> Callable[[Terms], list[Affine]]:
    """The corners: errors of the quantities (5,), affine in mu."""
    corners = scale_errors if parameters.robust_bounds == "mass_scale" else norm_errors
    return lambda terms: corners(w, terms)


def scale_errors(w: Walking, terms: Terms) -> list[Affine]:
    """For all masses times the least and the largest scale."""
    in_torque = Affine.stacked([quantity.value for quantity in terms.quantities])
    found = []
    for name in ("robust_scale_min", "robust_scale_max"):
        scale, n = w.gains[name], in_torque.b.numel()
        of_input = ca.vertcat(*(1 if i in FORCES else 1 / scale for i in range(n)))
        of_drift = ca.vertcat(*(scale if i in FORCES else 1 for i in range(n)))
        scaled = Affine(ca.diag(of_input) @ in_torque.a, of_drift * in_torque.b)
        found.append(scaled.after(terms.control) - terms.nominal)
    return found


def norm_errors(w: Walking, terms: Terms) -> list[Affine]:
    """For errors within bounds of their norms."""
    g, nominal = w.gains, terms.nominal
    size = ca.norm_2(terms.reads["LgV"])
    offset = ca.vertcat(size * g["robust_offset"], *2 * [-g["robust_barrier_offset"]], 0, 0)
    slope = ca.vertcat(g["robust_slope"], *2 * [g["robust_barrier_slope"]], 0, 0)
    drift = ca.vertcat(0, nominal.b[1:])  # Delta_2 multiplies mu, and not V-dot's own drift
    return [Affine(ca.diag(sign * slope) @ nominal.a, sign * slope * drift + offset) for sign in (-1, 1)]
