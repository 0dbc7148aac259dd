"""The nominal terms of a tick as expressions, of which objectives, rows and corners are made."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import casadi as ca
import numpy as np

from cbf_clf_qp.affine import Affine
from cbf_clf_qp.quantity import Constrained, Quantity
from cbf_clf_qp.rows import Number, Rows
from cbf_clf_qp.system import System

Reads = Mapping[str, ca.SX] | None


@dataclass(frozen=True)
class Terms:
    """Terms over mu (m,), by the nominal model.

    `control` is u and `nominal` are the quantities (n,), both affine in mu; `outputs` is y^(r) affine in u, if there is
    a CLF. `estimates` (alpha, beta) and `output_error` (Delta_2, Delta_1), affine in mu, are of the `symbols` that a
    tick's function has as inputs. `reads`: what the quantities show, and what else was asked for, by name.
    """

    system: System
    quantities: tuple[Quantity, ...]
    control: Affine
    nominal: Affine
    outputs: Affine | None
    symbols: Mapping[str, ca.SX]
    reads: Mapping[str, ca.SX]

    @classmethod
    def of(
        cls, system: System, constrained: Sequence[Constrained], control: Affine | None = None, reads: Reads = None
    ) -> "Terms":
        """Of a system; without a `control` that of input-output linearisation, where it can be, else u = mu."""
        quantities = tuple(each.on(system) for each in constrained)
        outputs = next((quantity.outputs for quantity in quantities if quantity.outputs), None)
        identity = Affine.identity(system.u.numel())
        if control is None:
            control = outputs.inverse() if outputs and outputs.a.is_square() else identity
        nothing = Affine(ca.SX(0, system.u.numel()), ca.SX(0, 1))
        nominal = Affine.stacked([nothing, *(quantity.value for quantity in quantities)]).after(control)
        n, m = nominal.a.shape
        symbols = {"x": system.x, "p": system.p, "alpha": ca.SX.sym("alpha", n, m), "beta": ca.SX.sym("beta", n)}
        symbols |= {"output_error": ca.SX.sym("output_error", m, m + 1)}
        shown = {name: value for quantity in quantities for name, value in quantity.reads.items()}
        terms = cls(system, quantities, control, nominal, outputs, symbols, shown | dict(reads or {}))
        if len(set(terms.names)) < n:
            raise ValueError(f"quantities {', '.join(terms.names)}: expected different names")
        return terms

    @property
    def estimates(self) -> Affine:
        """(alpha, beta) of all quantities."""
        return Affine(self.symbols["alpha"], self.symbols["beta"])

    @property
    def output_error(self) -> Affine:
        """(Delta_2, Delta_1)."""
        return Affine(self.symbols["output_error"][:, :-1], self.symbols["output_error"][:, -1])

    @property
    def inputs(self) -> int:
        """Components of mu."""
        return int(self.control.a.shape[1])

    @property
    def names(self) -> tuple[str, ...]:
        """Of the components of all quantities, in the order of every array over them."""
        return tuple(name for quantity in self.quantities for name in quantity.names)

    def rows(self, value: Affine) -> list[Rows]:
        """The rows of all quantities, if they are `value` (n,), affine in mu."""
        at = np.cumsum([0, *(len(quantity.names) for quantity in self.quantities)]).tolist()
        parts = [Affine(value.a[start:end, :], value.b[start:end]) for start, end in pairwise(at)]
        return [row for quantity, part in zip(self.quantities, parts, strict=True) for row in quantity.rows(part)]

    def input_rows(self, limit: Number) -> list[Rows]:
        """Hard rows |u| <= `limit` on each component; the mu that gives u = 0 always meets them."""
        names = tuple(f"u{i + 1}" for i in range(self.control.b.numel()))
        return [Rows(names, self.control.a, -limit - self.control.b, limit - self.control.b)]


Constraint = Callable[[Terms], list[Rows]]
