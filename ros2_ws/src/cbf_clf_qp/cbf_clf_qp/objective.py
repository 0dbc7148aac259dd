"""What the QP minimises over mu, beside the cost of its slacks: |root mu - center|^2.

    least_mu     mu' mu                                        the paper's: the least correction of the pre-control
    nearest      |weights (u(mu) - wanted)|^2                  a safety filter: the least change of a wanted input
    pd_centred   |E mu + Delta - v_PD|^2 + mu_weight |mu|^2    the outputs, as estimated, follow a PD law

y'' = E mu + Delta is the present estimate of the output dynamics: E = I + Delta_2, Delta = Delta_1 [delta_IO2]. The PD
law is that of the CLF's own Riccati equation (Q = I):  v_PD = -y / eps^2 - sqrt(3) dy / eps.

mu' mu asks for the smallest mu, whatever it does to the outputs: where the model is wrong and eta near 0, the smallest
mu lets the error Delta_1 drive the outputs away until the CLF row holds them, and the torque jumps from tick to tick.

For pd_centred root is upper triangular with root' root = E'E + mu_weight I, and root' center = E' (v_PD - Delta).
"""

from dataclasses import dataclass

import casadi as ca
import numpy as np

from cbf_clf_qp.affine import Affine, inverse


@dataclass(frozen=True)
class Objective:
    """|`root` mu - `center`|^2; `root` (m, m) regular, `center` (m,)."""

    root: ca.SX
    center: ca.SX


def nearest(control: Affine, wanted: ca.SX, weights: ca.SX | float = 1.0) -> Objective:
    """The input u = `control`(mu) that is nearest to `wanted` (m,), each component times its weight."""
    scale = ca.diag(weights * ca.SX.ones(wanted.numel()))
    return Objective(scale @ control.a, scale @ (wanted - control.b))


def pd_centred(y: ca.SX, dy: ca.SX, eps: ca.SX | float, output_error: Affine, mu_weight: ca.SX | float) -> Objective:
    """See above: E = I + `output_error.a`, Delta = `output_error.b`; y (m,) and dy (m,) are the outputs."""
    identity = ca.SX.eye(y.numel())
    E = identity + output_error.a
    wanted = -y / eps**2 - np.sqrt(3) * dy / eps
    root = ca.chol(E.T @ E + mu_weight * identity)
    return Objective(root, inverse(root).T @ (E.T @ (wanted - output_error.b)))
