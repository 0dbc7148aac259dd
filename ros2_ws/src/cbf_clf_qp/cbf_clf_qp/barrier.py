"""Exponential control barrier functions of any relative degree r [CBF_const].

    keep B >= 0:    B^(r) + K_b (B, ..., B^(r-1)) >= 0,    s^r + K_b (1, ..., s^(r-1)) = (s + p_1) ... (s + p_r)

The poles p_i are positive. The condition promises B >= 0 only from a state where B_0 = B and
B_i = B_(i-1)' + p_i B_(i-1) are not negative for i < r. Those are the `initial` values.

The error of B^(r) is measured by one difference of B^(r-1). For r > 2 that would not do (Remark 3): B^(r-1) then has
the drift of the model in it. The rows hold all the same under the nominal model.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from cbf_clf_qp.affine import Affine
from cbf_clf_qp.quantity import Number, Quantity, Rows, at_least
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
        """B^(r) as a quantity; raises DegreeError."""
        degree = len(self.poles)
        chain = system.derivatives(self.name, self.B, degree)
        factors = [ca.vertcat(*ecbf_gains(self.poles[:i]), 1) for i in range(degree)]
        initial = [ca.dot(factor, ca.vertcat(*chain[: i + 1])) for i, factor in enumerate(factors)]
        state = ca.vertcat(*chain[:degree])
        bound = -ca.dot(ca.vertcat(*ecbf_gains(self.poles)), state)

        def rows(value: Affine) -> list[Rows]:
            row = at_least((self.name,), value.a, bound - value.b, self.rescue_weight)
            return [row] if self.has_row else []

        return Quantity(
            (self.name,),
            system.affine(chain[-1], self.name),
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
