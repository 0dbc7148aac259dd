"""Least squares, some measurements a tick, for a vector that is constant or changes slowly.

x (n,) from pairs of a matrix H_k (m, n) and a vector z_k (m,),

    z_k = H_k x_k + noise_k,      x_k a random walk, noise white with covariance R_k (m, m)

Each tick, in this order, P (n, n) being the covariance of x's error:

    P <- P + walk                                   x may have changed; nothing else is forgotten
    K = P H' (H P H' + R)^-1
    x <- x + K (z - H x),   P <- P - K H P

With L D L' = H P H' + R and W = L^-1 H P that is P <- P - W' D^-1 W, of which half is computed: P stays symmetric.

What no measurement tells of keeps its value. The innovation z - H x is what x does not explain. Its normalised square

    (z - H x)' (H P H' + R)^-1 (z - H x) / m

is 1 in the mean where the measurements are as the problem says. Sources: Kalman (1960), with what is sought as the
state; Ljung, System Identification (1999), section 11; Bar-Shalom, Li, Kirubarajan (2001), section 5.4, on the square.
"""

import casadi as ca
from cbf_clf_qp.functions import symmetric
from cbf_clf_qp.qp import is_bounded
from rabbit_description.state import Array


def updated(
    value: ca.SX,
    covariance: ca.SX,
    walk: ca.SX | Array,
    regressor: ca.SX,
    measured: ca.SX,
    noise: ca.SX,
    learns: ca.SX | bool = True,
) -> tuple[ca.SX, ca.SX, ca.SX]:
    """x and P a tick later, and the innovation's normalised square, as expressions.

    x and P stay where it does not learn, or the numbers are too large to compute with.
    """
    covariance = symmetric(covariance)
    spread_now = covariance + symmetric(walk)
    along = spread_now @ regressor.T
    D, LT, _ = ca.ldl(symmetric(regressor @ along + noise), False)
    halves = forward(LT, ca.horzcat(along.T, measured - regressor @ value))  # L^-1 of H P, and of the innovation
    gained, innovation = halves[:, :-1], halves[:, -1]
    moved = value + gained.T @ (innovation / D)
    narrowed = symmetric(spread_now - gained.T @ (gained / ca.repmat(D, 1, value.numel())))
    square = ca.dot(innovation, innovation / D) / innovation.numel()
    is_good = ca.logic_and(learns, is_bounded(ca.vertcat(moved, ca.vec(narrowed))))
    return ca.if_else(is_good, moved, value), ca.if_else(is_good, narrowed, covariance), square


def upper(matrix: ca.SX) -> ca.SX:
    """The upper triangle of a matrix as a column: what is remembered of a covariance."""
    return ca.SX(ca.triu(ca.densify(matrix)).nz[:])


def from_upper(values: ca.SX, n: int) -> ca.SX:
    """The symmetric matrix (n, n) with this `upper` triangle."""
    return ca.triu2symm(ca.SX(ca.Sparsity.upper(n), values))


def forward(LT: ca.SX, right: ca.SX) -> ca.SX:
    """L^-1 `right` of the factor L = I + LT' of `ca.ldl`."""
    rows = list[ca.SX]()
    for i, row in enumerate(ca.vertsplit(right)):
        rows.append(row - sum((LT[j, i] * above for j, above in enumerate(rows)), start=ca.SX(0)))
    return ca.vertcat(*rows)


def within(share: ca.SX) -> ca.SX:
    """Cut to 0 and 1."""
    return ca.fmin(ca.fmax(share, 0), 1)
