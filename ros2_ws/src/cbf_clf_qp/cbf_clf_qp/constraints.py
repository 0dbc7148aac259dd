"""What is constrained: barriers, which keep the system where it may be, and a CLF, which pulls outputs to zero.

An exponential control barrier function of any relative degree r [CBF_const]:

    keep B >= 0:    B^(r) + K_b (B, ..., B^(r-1)) >= 0,    s^r + K_b (1, ..., s^(r-1)) = (s + p_1) ... (s + p_r)

The poles p_i are positive. The condition promises B >= 0 only from a state where B_0 = B and
B_i = B_(i-1)' + p_i B_(i-1) are not negative for i < r. Those are the `initial` values. The error of B^(r) is measured
by one difference of B^(r-1). For r > 2 that would not do (Remark 3): B'', ..., B^(r-1) then have the drift of the model
in them. So the quantity is there the whole left side of the condition, and its error that of all derivatives: the row
holds under the nominal model, and under another one that is known.

A rapidly exponentially stabilising control Lyapunov function (RES-CLF) of outputs y [CLF_cond], [eq:clf-lie]:

    eta = (y, ..., y^(r-1)),   eta-dot = F eta + G y^(r),   F a chain of r integrators for each of m outputs
    V = eta' P_eps eta,  P_eps = E P_0 E,  E = diag(1/eps^(r-1), ..., 1/eps, 1)
    A_0' P_0 + P_0 A_0 = -I,  A_0 = F + G K_0,  K_0 the gains at eps = 1
    condition:  V-dot + (clf_rate / eps) V <= 0,  clf_rate = 1 / max eig P_0

With K = K_0 E / eps the closed loop A = F + G K satisfies A' P_eps + P_eps A = -E^2 / eps, so the condition holds at
y^(r) = K eta for every eta.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from cbf_clf_qp.affine import Affine
from cbf_clf_qp.quantity import Number, Quantity, Rows, at_least, at_most
from cbf_clf_qp.system import System


@dataclass(frozen=True)
class Barrier:
    """Keep the expression `B` >= 0; the number of `poles`, 1/s, is its relative degree.

    `rescue_weight`: of the row's slack of last resort; `has_row`: False, and B is estimated and not constrained.
    Raises ValueError without a pole, or with one that is not positive.
    """

    name: str
    B: ca.SX
    poles: Sequence[Number]
    rescue_weight: Number = 1e6
    has_row: bool = True

    def __post_init__(self) -> None:
        wrong = [pole for pole in self.poles if isinstance(pole, float | int) and not 0 < pole < float("inf")]
        if wrong or not self.poles:
            raise ValueError(f"{self.name}: poles = {list(self.poles)}; expected positive rates in 1/s")

    def on(self, system: System) -> Quantity:
        """B^(r) as a quantity, for r > 2 with K_b (B, ..., B^(r-1)); raises DegreeError."""
        degree = len(self.poles)
        chain = system.derivatives(self.name, self.B, degree)
        factors = [ca.vertcat(*ecbf_gains(self.poles[:i]), 1) for i in range(degree)]
        initial = [ca.dot(factor, ca.vertcat(*chain[: i + 1])) for i, factor in enumerate(factors)]
        state = ca.vertcat(*chain[:degree])
        value, bound = system.affine(chain[-1], self.name), -ca.dot(ca.vertcat(*ecbf_gains(self.poles)), state)
        if degree > 2:
            value, bound = Affine(value.a, value.b - bound), ca.SX(0)

        def rows(value: Affine) -> list[Rows]:
            row = at_least((self.name,), value.a, bound - value.b, self.rescue_weight)
            return [row] if self.has_row else []

        return Quantity(
            (self.name,),
            value,
            rows,
            lower=chain[degree - 1] if degree <= 2 else None,
            slope=Affine.identity(1),
            reads={f"{self.name}_state": state, f"{self.name}_initial": ca.vertcat(*initial)},
        )


def ecbf_gains(poles: Sequence[Number]) -> list[Number]:
    """K_b, lowest derivative first: the coefficients of the product of all (s + pole) but the leading 1."""
    coefficients: list[Number] = [1.0]
    for pole in poles:
        coefficients = [low + pole * high for low, high in zip([0.0, *coefficients], [*coefficients, 0.0], strict=True)]
    return coefficients[:-1]


class ResClf:
    """The matrices of a RES-CLF for `outputs` outputs of relative degree `len(gains)`; y^(r) = -gains . eta at eps = 1.

    `eps`: positive; `gains`: (K_r, ..., K_1), lowest derivative first. Raises ValueError where the gains do not
    stabilise the chain of integrators, or eps is not positive.
    """

    def __init__(self, outputs: int, eps: Number, gains: Sequence[float]) -> None:
        if isinstance(eps, float | int) and not eps > 0:
            raise ValueError(f"eps = {eps}: expected a positive number")
        degree = len(gains)
        chain = np.eye(degree, k=1)
        closed = np.vstack([chain[:-1], -np.asarray(gains)])
        if np.linalg.eigvals(closed).real.max() >= 0:
            raise ValueError(f"gains = {list(gains)} do not stabilise {degree} integrators")
        from scipy.linalg import solve_continuous_lyapunov  # slow to import

        p_0 = solve_continuous_lyapunov(closed.T, -np.eye(degree))
        identity = ca.DM.eye(outputs)
        scaling = ca.diag(ca.vertcat(*(ca.SX(eps) ** -k for k in range(degree - 1, -1, -1))))
        self.rate = float(1 / np.linalg.eigvalsh(p_0).max()) / eps  # clf_rate / eps, 1/s
        self.F = ca.kron(ca.DM(chain), identity)
        self.G = ca.kron(ca.DM(np.eye(degree)[:, -1:]), identity)
        self.P = ca.kron(scaling @ ca.DM(p_0) @ scaling, identity)
        self.K = ca.kron(-ca.DM(np.reshape(gains, (1, -1))) @ scaling / eps, identity)

    def value(self, eta: ca.SX) -> ca.SX:
        """V."""
        return ca.bilin(self.P, eta, eta)

    def derivative(self, eta: ca.SX) -> Affine:
        """V-dot, affine in y^(r): `a` = LgV (1, m), `b` = LfV."""
        LfV = ca.bilin(self.F.T @ self.P + self.P @ self.F, eta, eta)
        return Affine(2 * eta.T @ self.P @ self.G, LfV)


@dataclass(frozen=True)
class Clf:
    """Pull the outputs `y` (m,) to zero; the number of `gains` is their relative degree.

    `slack_weight`: p, of the row's slack d; `rescue`: that slack is one of last resort, and not the paper's d.
    `in_mu`: d is in units of mu, see `Rows`.
    """

    y: ca.SX
    eps: Number = 0.3
    gains: Sequence[float] = (1.0, 2.0)
    slack_weight: Number = 10.0
    rescue: bool = False
    in_mu: bool = True

    def on(self, system: System) -> Quantity:
        """V-dot as a quantity, for r > 2 with (clf_rate / eps) V; raises DegreeError."""
        degree, m = len(self.gains), self.y.numel()
        chain = system.derivatives("the outputs of the CLF", self.y, degree)
        eta, y_r = ca.vertcat(*chain[:-1]), system.affine(chain[-1])
        clf = ResClf(m, self.eps, self.gains)
        V, V_dot = clf.value(eta), clf.derivative(eta)
        whole, bound = V_dot.after(y_r), -clf.rate * V
        if degree > 2:
            whole, bound = Affine(whole.a, whole.b - bound), ca.SX(0)
        return Quantity(
            ("V",),
            whole,
            lambda value: [at_most(("CLF",), value.a, bound - value.b, self.slack_weight, self.rescue, self.in_mu)],
            lower=eta[-m:] if degree <= 2 else None,
            slope=V_dot,
            outputs=y_r,
            reads={"V": V, "eta": eta, "LgV": V_dot.a.T, "LfV": V_dot.b},
        )
