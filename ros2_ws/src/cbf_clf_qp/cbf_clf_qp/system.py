"""A system that is affine in its input, and the derivatives that its constraints need.

    x-dot = f(x, p) + g(x, p) u,      p-dot = r(x, p) for the parameters that have rates, else 0

The parameters p are inputs of every function that is made of the system: an obstacle's place, a mass, a gain. So none
of them can be stale. One that moves by itself should declare its rate, as a wall its speed: then B-dot has it.
"""

from collections.abc import Iterable, Mapping
from typing import Any

import casadi as ca
import numpy as np

from cbf_clf_qp.affine import Affine
from cbf_clf_qp.functions import free_symbols, packed

ROUNDING = 1e-11  # what is left where u cancels, relative to what cancels
Symbols = Mapping[str, ca.SX]


class DegreeError(ValueError):
    """A constraint whose relative degree is another one than was said."""


class System:
    """State `x` (n,), input `u` (m,), both symbols, and the expression `x_dot` (n,), affine in u.

    `parameters`: symbols by name, or scalar symbols, which have names of their own; `rates`: the time derivatives of
    some of them, by name. `named` has the parameters by name, `p` as one column. Raises ValueError where these do not
    fit together, or depend on another symbol.
    """

    def __init__(
        self, x: ca.SX, u: ca.SX, x_dot: ca.SX, parameters: Symbols | Iterable[ca.SX] = (), rates: Symbols | None = None
    ) -> None:
        self.x, self.u, self.x_dot, self.rates = x, u, x_dot, rates or {}
        named = list(parameters.items() if isinstance(parameters, Mapping) else ((p.name(), p) for p in parameters))
        self.named, names = dict(named), ", ".join(name for name, _ in named)
        self.p = packed(self.named)
        if len(self.named) < len(named):
            raise ValueError(f"parameters {names}: expected different names")
        if self.rates.keys() - self.named.keys():
            raise ValueError(f"rates of {', '.join(self.rates)}: expected parameters, {names}")
        if x_dot.shape != x.shape:
            raise ValueError(f"x_dot has {x_dot.numel()} components; expected {x.numel()}")
        for name, expression in {"x_dot": x_dot, **{f"the rate of {k}": r for k, r in self.rates.items()}}.items():
            self._check_known(name, expression)
        self.affine(x_dot, "x_dot")

    def _check_known(self, name: str, expression: ca.SX) -> None:
        if unknown := free_symbols(expression, (self.x, self.u, self.p)):
            raise ValueError(f"{name} depends on {unknown}: expected x, u and declared parameters")

    def derivative(self, expression: ca.SX) -> ca.SX:
        """The time derivative of an expression of x and p, along the system."""
        total = ca.jtimes(expression, self.x, self.x_dot)
        for name, rate in self.rates.items():
            total += ca.jtimes(expression, self.named[name], rate)
        return ca.simplify(total)

    def derivatives(self, name: str, expression: ca.SX, degree: int) -> list[ca.SX]:
        """An expression and its time derivatives up to the relative `degree`, the only one that u is in.

        Raises DegreeError, with the `name`, where u enters earlier or not at all.
        """
        self._check_known(name, expression)
        if ca.depends_on(expression, self.u):
            raise DegreeError(f"{name}: relative degree 0, but {degree} was given")
        chain = [expression]
        for order in range(1, degree + 1):
            rate = self.derivative(chain[-1])
            has_input = self._has_input(chain[-1], rate)
            if order < degree and any(has_input):
                raise DegreeError(f"{name}: relative degree {order}, but {degree} was given")
            if order == degree and not all(has_input):
                raise DegreeError(f"{name}: derivative {degree} does not depend on u; expected the relative degree")
            chain.append(rate if order == degree else self.affine(rate).b)
        return chain

    def _has_input(self, expression: ca.SX, rate: ca.SX) -> list[bool]:
        """Whether u is in the derivative, `rate`, of each component, and does not cancel: at a few random states."""
        slope, of_u = ca.jacobian(rate, self.u), ca.jacobian(self.x_dot, self.u)
        size = (1 + ca.fabs(ca.jacobian(expression, self.x))) @ ca.fabs(of_u)
        cancels = ca.Function("cancels", [self.x, self.p], [ca.sum2(ca.fabs(slope)) <= ROUNDING * ca.sum2(size)])
        points = np.random.default_rng(0).uniform(0.5, 1.5, (self.x.numel() + self.p.numel(), 5))
        remainders = cancels(*np.split(points, [self.x.numel()])).full()
        return [not row.all() for row in remainders]

    def affine(self, expression: ca.SX, name: str = "expression") -> Affine:
        """An expression as a u + b; raises ValueError where it is not affine in u."""
        a = ca.jacobian(expression, self.u)
        if ca.depends_on(a, self.u):
            raise ValueError(f"{name} is not affine in u")
        return Affine(a, ca.substitute(expression, self.u, ca.SX.zeros(self.u.shape)))


def mechanical(q: ca.SX, dq: ca.SX, u: ca.SX, M: ca.SX, h: ca.SX, B: ca.SX, **declared: Any) -> System:
    """M(q) q'' + h(q, q') = B u as a system with the state (q, q'); `M` (n, n) is symmetric and positive definite.

    `declared`: `parameters` and `rates` of the system.
    """
    return System(ca.vertcat(q, dq), u, ca.vertcat(dq, solved(M, B @ u - h)), **declared)


def solved(matrix: ca.SX, right: ca.SX) -> ca.SX:
    """`matrix`^-1 `right` of a symmetric, positive definite matrix, by L D L'."""
    D, LT, order = ca.ldl(matrix, False)
    return ca.ldl_solve(right, D, LT, order)
