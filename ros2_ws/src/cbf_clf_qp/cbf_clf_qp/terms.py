"""The nominal terms of a tick as expressions, of which objectives, rows and corners are made."""

from collections.abc import Callable, Sequence

import casadi as ca
import numpy as np

from cbf_clf_qp.affine import Affine
from cbf_clf_qp.quantity import Constrained, Rows
from cbf_clf_qp.system import System


class Terms:
    """Terms over mu (m,), by the nominal model of a `system`.

    `control` is u and `nominal` are the `quantities` (n,), both affine in mu; `outputs` is y^(r) affine in u, if there
    is a CLF. `estimates` (alpha, beta) and `output_error` (Delta_2, Delta_1), affine in mu, are of the `symbols` that a
    tick's function has as inputs.
    Without a `control`: that of input-output linearisation [eq:io_input_model], where it can be, else u = mu.
    """

    def __init__(self, system: System, constrained: Sequence[Constrained], control: Affine | None = None) -> None:
        self.system, self.quantities = system, tuple(each.on(system) for each in constrained)
        self.names = tuple(name for quantity in self.quantities for name in quantity.names)
        if len(set(self.names)) < len(self.names):
            raise ValueError(f"quantities {', '.join(self.names)}: expected different names")
        self.outputs = next((quantity.outputs for quantity in self.quantities if quantity.outputs), None)
        if control is None:
            y_r, identity = self.outputs, Affine.identity(system.u.numel())
            control = y_r.inverse() if y_r and y_r.a.is_square() else identity
        nothing = Affine(ca.SX(0, system.u.numel()), ca.SX(0, 1))
        self.control = control
        self.nominal = Affine.stacked([nothing, *(quantity.value for quantity in self.quantities)]).after(control)
        n, m = self.nominal.a.shape
        self.inputs = int(m)
        alpha, beta, error = ca.SX.sym("alpha", n, m), ca.SX.sym("beta", n), ca.SX.sym("output_error", m, m + 1)
        self.symbols = {"x": system.x, "p": system.p, "alpha": alpha, "beta": beta, "output_error": error}
        self.estimates, self.output_error = Affine(alpha, beta), Affine(error[:, :-1], error[:, -1])

    def rows(self, value: Affine) -> list[Rows]:
        """The rows of all quantities, if they are `value` (n,), affine in mu."""
        at = np.cumsum([0, *(len(quantity.names) for quantity in self.quantities)]).tolist()
        parts = zip(self.quantities, ca.vertsplit(value.a, at), ca.vertsplit(value.b, at), strict=True)
        return [row for quantity, a, b in parts for row in quantity.rows(Affine(a, b))]


Constraint = Callable[[Terms], list[Rows]]
