"""What the quantities really were over a tick, and what another model says of them.

`measure` asks no model: it takes one difference [Remark 3]. A learner compares it with the nominal value.
`model_error` gives the estimates that turn the nominal model into another one: those of an oracle, or of a robot that
has been identified.
"""

import casadi as ca

from cbf_clf_qp.symbolic.affine import Affine
from cbf_clf_qp.symbolic.functions import NumpyFunction
from cbf_clf_qp.symbolic.terms import Terms


def measure(terms: Terms) -> NumpyFunction:
    """`measured` (n,) of (x_0, p_0, x_1, p_1, seconds): the means of all quantities between two states.

    Raises:
        ValueError: a quantity of relative degree 3 or more: one difference does not isolate its error.
    """
    x, p = terms.system.x, terms.system.p
    seconds = ca.SX.sym("seconds")
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
            names = ", ".join(quantity.names)
            raise ValueError(f"{names}: one difference measures relative degrees 1 and 2 only (Remark 3)")
    symbols = dict(zip(("x_0", "p_0", "x_1", "p_1", "seconds"), (*start, *end, seconds), strict=True))
    return NumpyFunction.of("measure", symbols, {"measured": ca.vertcat(*measured)})


def model_error(terms: Terms) -> NumpyFunction:
    """`alpha` (n, m), `beta` (n,), `output_error` (m, m + 1) of (x, p, other): the parameters of another model.

    They are zero where the two are the same.
    """
    p, other = terms.system.p, ca.SX.sym("other", terms.system.p.numel())

    def by_other(value: Affine) -> Affine:
        a, b = ca.substitute([value.a, value.b], [p], [other])
        return Affine(a, b).after(terms.control)

    error = by_other(Affine.stacked([quantity.value for quantity in terms.quantities])) - terms.nominal
    found = {"alpha": error.a, "beta": error.b, "output_error": ca.SX.zeros(terms.inputs, terms.inputs + 1)}
    if terms.outputs is not None:
        outputs = by_other(terms.outputs) - terms.outputs.after(terms.control)
        found["output_error"] = ca.horzcat(outputs.a, outputs.b)
    return NumpyFunction.of(
        "model_error", {"x": terms.system.x, "p": p, "other": other}, found, ("alpha", "output_error")
    )
