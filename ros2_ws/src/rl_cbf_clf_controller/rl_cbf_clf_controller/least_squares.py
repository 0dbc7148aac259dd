"""Least squares, one measurement a tick, for what is constant or changes slowly.

`MatrixFit` finds D (n, n) from pairs of vectors,

    error_k = D_k phi_k + noise_k,      D_k a random walk, noise white with standard deviation `noise`.

The rows of D share the regressor phi, so they share one covariance P (n, n). Each tick, in this order:

    P <- P + walk I                                 D may have changed; nothing else is forgotten
    k = P phi / (noise^2 + phi' P phi)
    D <- D + (error - D phi) k',   P <- P - k phi' P

A direction that no regressor excites keeps its D. `ScalarFit` finds a constant scalar s from
error_k = s phi_k + noise_k likewise, P a number and s kept in [0, most].
Sources: Kalman (1960), with what is sought as the state; Ljung, System Identification (1999), section 11.
"""

import numpy as np
from rabbit_description.state import Array


class MatrixFit:
    """`value` (n, n), zero at first, its entries' variance `prior` there and `walk` more each tick."""

    def __init__(self, size: int, prior: float, noise: float, walk: float) -> None:
        self.value = np.zeros((size, size))
        self._covariance = prior * np.eye(size)
        self._walk = walk * np.eye(size)
        self._noise_variance = noise**2

    def update(self, error: Array, regressor: Array) -> None:
        """Take in a pair, both (n,)."""
        self._covariance = self._covariance + self._walk
        along = self._covariance @ regressor
        gain = along / (self._noise_variance + regressor @ along)
        self.value = self.value + np.outer(error - self.value @ regressor, gain)
        self._covariance = self._covariance - np.outer(gain, along)


class ScalarFit:
    """`value`, 0 at first, its variance `prior` there; kept in [0, `most`]."""

    def __init__(self, prior: float, noise: float, most: float) -> None:
        self.value = 0.0
        self._variance, self._noise_variance, self._most = prior, noise**2, most

    def update(self, error: Array, regressor: Array) -> None:
        """Take in a pair, both (n,)."""
        gain = self._variance * regressor / (self._noise_variance + self._variance * (regressor @ regressor))
        new = self.value + float(gain @ (error - self.value * regressor))
        self.value = min(max(new, 0.0), self._most)
        self._variance *= 1 - float(gain @ regressor)
