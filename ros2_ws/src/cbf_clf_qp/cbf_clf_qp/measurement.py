"""What the quantities really were over a tick, and what another model says of them.

`measure` asks no model: it takes one difference [Remark 3]. A learner compares it with the nominal value.
`model_error` gives the estimates that turn the nominal model into another one: those of an oracle, or of a robot that
has been identified.
"""

import casadi as ca

from cbf_clf_qp.affine import Affine
from cbf_clf_qp.functions import NumpyFunction
from cbf_clf_qp.quantity import Quantity
from cbf_clf_qp.system import System
from cbf_clf_qp.terms import Terms


def measure(terms: Terms) -> NumpyFunction:
    """`measured` (n,) of (x_0, p_0, x_1, p_1, seconds): the means of all quantities between two states.

    Raises ValueError for a quantity of relative degree 3 or more: one difference does not isolate its error.
    """
    x, p, seconds = terms.system.x, terms.system.p, ca.SX.sym("seconds")
    start = ca.SX.sym("x_0", x.numel()), ca.SX.sym("p_0", p.numel())
    end = ca.SX.sym("x_1", x.numel()), ca.SX.sym("p_1", p.numel())
    measured = []
    for quantity in terms.quantities:
        if quantity.sensor is not None:
            measured += ca.substitute([quantity.sensor], [x, p], end)
        elif quantity.lower is not None and quantity.slope is not None:
            (before,), (after,) = (ca.substitute([quantity.lower], [x, p], at) for at in (start, end))
            a, b = ca.substitute([quantity.slope.a, quantity.slope.b], [x, p], start)
            measured.append(Affine(a, b)((after - before) / seconds))
        else:
            raise ValueError(f"{quantity.names[0]}: one difference measures relative degrees 1 and 2 only (Remark 3)")
    symbols = dict(zip(("x_0", "p_0", "x_1", "p_1", "seconds"), (*start, *end, seconds), strict=True))
    return NumpyFunction.of("measure", symbols, {"measured": ca.vertcat(*measured)})


def model_error(terms: Terms) -> NumpyFunction:
    """`alpha` (n, m), `beta` (n,), `output_error` (m, m + 1) of (x, p, other): the parameters of another model.

    The other model says how the state moves. What a barrier or an output is of a state does not change with it. The
    error is zero where the two models are the same.
    """
    system, other = terms.system, ca.SX.sym("other", terms.system.p.numel())
    (x_dot,) = ca.substitute([system.x_dot], [system.p], [other])
    moved = System(system.x, system.u, x_dot, {**system.named, "other": other}, system.rates)

    def by_other(quantity: Quantity) -> tuple[Affine, Affine | None]:
        """Its value, and that of the outputs, affine in u."""
        if quantity.lower is None or quantity.slope is None:
            return Affine(*ca.substitute([quantity.value.a, quantity.value.b], [system.p], [other])), None
        rate = moved.affine(moved.derivative(quantity.lower))
        return quantity.slope.after(rate), rate if quantity.outputs else None

    values, outputs = zip(*map(by_other, terms.quantities), strict=True)
    error = Affine.stacked(values).after(terms.control) - terms.nominal
    found = {"alpha": error.a, "beta": error.b, "output_error": ca.SX.zeros(terms.inputs, terms.inputs + 1)}
    y_r = next((each for each in outputs if each), None)
    if y_r is not None and terms.outputs is not None:
        output_error = y_r.after(terms.control) - terms.outputs.after(terms.control)
        found["output_error"] = ca.horzcat(output_error.a, output_error.b)
    inputs = {"x": system.x, "p": system.p, "other": other}
    return NumpyFunction.of("model_error", inputs, found, matrices=("alpha", "output_error"))
