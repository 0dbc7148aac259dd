"""Least squares, some measurements a tick, for a vector that is constant or changes slowly.

x (n,) from pairs of a matrix H_k (m, n) and a vector z_k (m,),

    z_k = H_k x_k + noise_k,      x_k a random walk, noise white with covariance R_k (m, m)

Each tick, in this order, P (n, n) being the covariance of x's error:

    P <- P + walk                                   x may have changed; nothing else is forgotten
    K = P H' (H P H' + R)^-1
    x <- x + K (z - H x),   P <- P - K H P

What no measurement tells of keeps its value. Sources: Kalman (1960), with what is sought as the state; Ljung, System
Identification (1999), section 11.
"""

import numpy as np
from rabbit_description.state import Array


class LeastSquares:
    """`value` (n,), at first `start`, its error's covariance `prior` (n, n) there and `walk` (n, n) more each tick."""

    def __init__(self, start: Array, prior: Array, walk: Array) -> None:
        self.value = start
        self._covariance = prior
        self._walk = walk

    def update(self, regressor: Array, measured: Array, noise: Array) -> None:
        """Take in H (m, n), z (m,) and R (m, m); numbers too large to reckon with are left out."""
        if not (np.isfinite(regressor).all() and np.isfinite(measured).all()):
            return
        covariance = self._covariance + self._walk
        along = covariance @ regressor.T
        gain = np.linalg.solve(regressor @ along + noise, along.T).T
        value = self.value + gain @ (measured - regressor @ self.value)
        covariance = covariance - gain @ along.T
        if np.isfinite(value).all() and np.isfinite(covariance).all():
            self.value, self._covariance = value, (covariance + covariance.T) / 2
