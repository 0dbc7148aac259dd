"""The nominal terms of a tick as expressions, of which objectives, rows and corners are made."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca

from cbf_clf_qp.symbolic.affine import Affine
from cbf_clf_qp.symbolic.clf import Clf
from cbf_clf_qp.symbolic.quantity import Constrained, Quantity
from cbf_clf_qp.symbolic.rows import Rows, between
from cbf_clf_qp.symbolic.system import System


@dataclass(frozen=True)
class Terms:
    """Terms over mu (m,), by the nominal model.

    `control` is u and `nominal` are the quantities (n,), both affine in mu; `outputs` is y^(r) affine in u, if there is
    a CLF. `estimates` (alpha, beta) and `output_error` (Delta_2, Delta_1) are affine in mu, of symbols. `reads`: what
    the quantities show, and what else was asked for, by name.
    """

    system: System
    quantities: tuple[Quantity, ...]
    control: Affine
    nominal: Affine
    outputs: Affine | None
    estimates: Affine
    output_error: Affine
    reads: Mapping[str, ca.SX]

    @classmethod
    def of(
        cls,
        system: System,
        constrained: Sequence[Constrained],
        control: Affine | None = None,
        reads: Mapping[str, ca.SX] | None = None,
    ) -> "Terms":
        """Of a system; without a `control` that of input-output linearisation, where it can be, else u = mu."""
        quantities = tuple(each.on(system) for each in constrained)
        outputs = next((each.outputs(system)[1] for each in constrained if isinstance(each, Clf)), None)
        if control is None:
            can_be = outputs is not None and outputs.a.is_square()
            control = outputs.inverse() if outputs and can_be else Affine.identity(system.u.numel())
        n, m = sum(len(quantity.names) for quantity in quantities), control.a.shape[1]
        nothing = Affine(ca.SX(0, system.u.numel()), ca.SX(0, 1))
        nominal = Affine.stacked([nothing, *(quantity.value for quantity in quantities)]).after(control)
        shown = {name: value for quantity in quantities for name, value in quantity.reads.items()}
        estimates = Affine(ca.SX.sym("alpha", n, m), ca.SX.sym("beta", n))
        output_error = Affine(ca.SX.sym("Delta_2", m, m), ca.SX.sym("Delta_1", m))
        return cls(system, quantities, control, nominal, outputs, estimates, output_error, shown | dict(reads or {}))

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
        rows, start = list[Rows](), 0
        for quantity in self.quantities:
            end = start + len(quantity.names)
            rows += quantity.rows(Affine(value.a[start:end, :], value.b[start:end]))
            start = end
        return rows


Constraint = Callable[[Terms], list[Rows]]


def input_limit(limit: ca.SX | float) -> Constraint:
    """Hard rows |u| <= `limit` on each component; the mu that gives u = 0 always meets them."""

    def rows(terms: Terms) -> list[Rows]:
        control = terms.control
        names = [f"u{i + 1}" for i in range(control.b.numel())]
        return [between(names, control.a, -limit - control.b, limit - control.b)]

    return rows
