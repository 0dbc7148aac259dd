"""What the QP minimises over mu, beside the cost of its slacks.

    paper         mu' mu                                        the least correction of the nominal pre-control
    pd_centred    |E mu + Delta - v_PD|^2 + mu_weight |mu|^2    the outputs, as estimated, follow a PD law

y'' = E mu + Delta is the present estimate of the output dynamics: E = I + Delta_2, Delta = Delta_1 [delta_IO2], by the
policy, the oracle or the adaptation. The PD law is that of the CLF's own Riccati equation (Q = I):

    v_PD = -y / eps^2 - sqrt(3) dy / eps

mu' mu asks for the smallest mu, whatever it does to the outputs: where the model is wrong and eta near 0, the smallest
mu lets the error Delta_1 drive the outputs away until the CLF row holds them, and the torque jumps from tick to tick.

Both are |root mu - center|^2 and a constant: root is upper triangular with root' root = E'E + mu_weight I, regular as
mu_weight > 0, and root' center = E' (v_PD - Delta).
"""

from dataclasses import dataclass

import numpy as np

from cbf_clf_qp.affine import Affine, Array
from cbf_clf_qp.symbols import cholesky, inverse


@dataclass(frozen=True)
class Objective:
    """|`root` mu - `center`|^2; `root` (m, m) regular, `center` (m,)."""

    root: Array
    center: Array


def pd_input(y: Array, dy: Array, eps: float) -> Array:
    """v_PD (m,), rad/s^2, at the outputs `y` (m,), rad, and their rates `dy` (m,), rad/s."""
    return -y / eps**2 - np.sqrt(3) * dy / eps


def pd_centred(wanted: Array, output_error: Affine, mu_weight: float) -> Objective:
    """|E mu + Delta - wanted|^2 + mu_weight |mu|^2 with E = I + `output_error.a`, Delta = `output_error.b`, rad/s^2."""
    m = len(wanted)
    E = np.eye(m) + output_error.a
    root = cholesky(E.T @ E + mu_weight * np.eye(m))
    return Objective(root, inverse(root).T @ (E.T @ (wanted - output_error.b)))
