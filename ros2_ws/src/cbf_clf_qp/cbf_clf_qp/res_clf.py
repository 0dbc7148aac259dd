"""Rapidly exponentially stabilising control Lyapunov function on the transverse dynamics [CLF_cond], [eq:clf-lie].

    eta-dot = F eta + G y^(r),  F a chain of r integrators for each of m outputs
    V = eta' P_eps eta,  P_eps = E P_0 E,  E = diag(1/eps^(r-1), ..., 1/eps, 1)
    A_0' P_0 + P_0 A_0 = -I,  A_0 = F + G K_0,  K_0 the gains at eps = 1
    condition:  V-dot + (clf_rate / eps) V <= 0,  clf_rate = 1 / max eig P_0

With K = K_0 E / eps the closed loop A = F + G K satisfies A' P_eps + P_eps A = -E^2 / eps, so the condition holds at
mu = K eta for every eta.
"""

from collections.abc import Sequence
from typing import cast

import numpy as np
from scipy.linalg import solve_continuous_lyapunov

from cbf_clf_qp.affine import Affine, Array


class ResClf:
    """RES-CLF for `outputs` outputs of relative degree `len(gains)`; y^(r) = -gains . (y, ..., y^(r-1)) at eps = 1.

    Args:
        outputs: m.
        eps: epsilon, in (0, 1].
        gains: positive feedback gains (K_r, ..., K_1), lowest derivative first; stable by choice.

    Raises:
        ValueError: the gains do not stabilise the chain of integrators.
    """

    def __init__(self, outputs: int, eps: float, gains: Sequence[float]) -> None:
        degree = len(gains)
        chain = np.eye(degree, k=1)
        closed = chain.copy()
        closed[-1] = -np.asarray(gains)
        if np.linalg.eigvals(closed).real.max() >= 0:
            raise ValueError(f"gains = {list(gains)} do not stabilise {degree} integrators")
        p_0 = solve_continuous_lyapunov(closed.T, -np.eye(degree))
        scaling = np.diag(eps ** -np.arange(degree - 1, -1, -1.0))
        identity = np.eye(outputs)
        self.eps = eps
        self.clf_rate = float(1 / np.linalg.eigvalsh(p_0).max())
        self.F = np.kron(chain, identity)
        self.G = np.kron(np.eye(degree)[:, -1:], identity)
        self.P_eps = np.kron(scaling @ p_0 @ scaling, identity)
        self.K = np.kron(-np.asarray(gains) @ scaling / eps, identity)
        self._drift = self.F.T @ self.P_eps + self.P_eps @ self.F
        self._input = 2 * self.P_eps @ self.G

    def value(self, eta: Array) -> float:
        """V at `eta` (m r,)."""
        return cast(float, eta @ self.P_eps @ eta)  # float() would not do for symbols, see `symbols.py`

    def LgV(self, eta: Array) -> Array:
        """LgV (m,), the slope of V-dot in y^(r)."""
        slope: Array = eta @ self._input
        return slope

    def derivative(self, eta: Array) -> Affine:
        """V-dot, affine in y^(r): `a` = LgV (1, m), `b` = LfV (1,)."""
        return Affine(self.LgV(eta)[None], np.array([eta @ self._drift @ eta]))

    def bound(self, eta: Array) -> float:
        """What V-dot must not exceed: -(clf_rate / eps) V."""
        return -self.clf_rate / self.eps * self.value(eta)
