"""Least squares, some measurements a tick, for a vector that is constant or changes slowly.

x (n,) from pairs of a matrix H_k (m, n) and a vector z_k (m,),

    z_k = H_k x_k + noise_k,      x_k a random walk, noise white with covariance R_k (m, m)

Each tick, in this order, P (n, n) being the covariance of x's error:

    P <- P + walk                                   x may have changed; nothing else is forgotten
    K = P H' (H P H' + R)^-1
    x <- x + K (z - H x),   P <- P - K H P

What no measurement tells of keeps its value. The innovation z - H x is what x does not explain. Its normalised square

    (z - H x)' (H P H' + R)^-1 (z - H x) / m

is 1 in the mean where the measurements are as the problem says. Sources: Kalman (1960), with what is sought as the
state; Ljung, System Identification (1999), section 11; Bar-Shalom, Li, Kirubarajan (2001), section 5.4, on the square.
"""

import casadi as ca
from cbf_clf_qp.qp import is_finite
from cbf_clf_qp.system import solved
from rabbit_description.state import Array


def updated(
    value: ca.SX, covariance: ca.SX, walk: ca.SX | Array, regressor: ca.SX, measured: ca.SX, noise: ca.SX
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """x and P a tick later, and the innovation's normalised square, as expressions.

    x and P stay where the numbers are too large to compute with.
    """
    spread_now = covariance + walk
    along = spread_now @ regressor.T
    spread, innovation = regressor @ along + noise, measured - regressor @ value
    gain = solved(spread, along.T).T
    found = value + gain @ innovation
    narrowed = spread_now - gain @ along.T
    narrowed = (narrowed + narrowed.T) / 2
    square = ca.dot(innovation, solved(spread, innovation)) / innovation.numel()
    is_good = is_finite(ca.vertcat(found, ca.vec(narrowed)))
    return ca.if_else(is_good, found, value), ca.if_else(is_good, narrowed, covariance), square


def within(share: ca.SX) -> ca.SX:
    """Cut to 0 and 1."""
    return ca.fmin(ca.fmax(share, 0), 1)
