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

from dataclasses import replace

import numpy as np
from cbf_clf_qp.affine import Affine, Array
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.tick import Estimator, Terms

from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.scene import Scene

FORCES = slice(3, 5)  # of the quantities V, B1, B2, F_N, F_T


class WorstCase(Estimator[Scene]):
    """No estimate of the error, but the corners of the set that it lies in."""

    def __init__(self, parameters: ControllerParameters) -> None:
        self._parameters = parameters
        self._zero = Estimates.zero(5, 4)

    def estimate(self, terms: Terms[Scene], before: Estimates) -> Estimates:
        """Zero, with the corners."""
        return replace(self._zero, corners=tuple(self.corners(terms)))

    def corners(self, terms: Terms[Scene]) -> list[Affine]:
        """Errors of the quantities (5), affine in mu (4)."""
        p = self._parameters
        if p.robust_bounds == "mass_scale":
            return [_scale_error(terms, scale) for scale in (p.robust_scale_min, p.robust_scale_max)]
        offset = np.array([np.linalg.norm(terms.scene.LgV) * p.robust_offset, *2 * [-p.robust_barrier_offset], 0, 0])
        slope = np.array([p.robust_slope, *2 * [p.robust_barrier_slope], 0, 0])
        return [_norm_error(terms.nominal, sign * slope, offset) for sign in (-1, 1)]


def _scale_error(terms: Terms[Scene], scale: float) -> Affine:
    of_torque = terms.nominal.after(terms.precontrol.inverse())
    gain, drift = np.full(5, 1 / scale), np.ones(5)
    gain[FORCES], drift[FORCES] = 1, scale
    return Affine(gain[:, None] * of_torque.a, drift * of_torque.b).after(terms.precontrol) - terms.nominal


def _norm_error(nominal: Affine, slope: Array, offset: Array) -> Affine:
    drift = nominal.b.copy()
    drift[0] = 0  # Delta_2 multiplies mu, and not V-dot's own drift
    return Affine(slope[:, None] * nominal.a, slope * drift + offset)
