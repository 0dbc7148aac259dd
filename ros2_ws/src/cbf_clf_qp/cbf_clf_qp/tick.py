"""One tick of a CBF-CLF-QP: from a state and estimates to mu and the input. Read this file first.

    u       = control(mu)                                 from the nominal model: y^(r) = mu [eq:io_input_model]
    nominal = quantities by the nominal model             V-dot, B^(r), ...: affine in mu
    value   = nominal + alpha mu + beta                   estimates: a policy's, an identified model's, an oracle's
    rows    = of each quantity, if it has that value, and of further constraints
    mu      = argmin objective  subject to rows           see `qp.py`

All of it is expressions of declared inputs: the state x, the parameters p of the system, the estimates. For example a
cart that is pulled to x = 1 m and must not pass a wall, wherever the wall is at this tick:

    cart = System(ca.vertcat(x, v), u, ca.vertcat(v, u / 2.0), parameters=[wall])
    tick = Tick(cart, [Clf(x - 1, eps=0.2), Barrier("wall", wall - x, poles=(8, 8))], limit=100)
    u = tick(np.array([0.0, 0.0]), wall=0.9).u
"""

from collections.abc import Callable, Sequence
from copy import copy
from typing import Any

import casadi as ca
import numpy as np

from cbf_clf_qp.affine import Affine
from cbf_clf_qp.answer import Answering, Decided
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.functions import Array, NumpyFunction, Values, one_at_a_time, packed, places_of
from cbf_clf_qp.qp import build_qp, is_bounded
from cbf_clf_qp.quantity import Constrained, Constraint, Number, Rows, Terms
from cbf_clf_qp.system import Symbols, System

MATRICES = ("nominal_a", "control_a")  # which stay so with one column


class Tick:
    """The tick of a `system` whose `quantities` are constrained, as functions of x, p and the estimates.

    Args:
        control: u affine in mu. None: y^(r) = mu where a CLF has as many outputs as there are inputs, else u = mu.
        limit: of |u|, hard, on each component; an expression or a number.
        constraints: further rows.
        objective: of the terms, affine in mu, see `qp.py`; None, for itself or as its value: the paper's mu' mu.
        corners: further errors of the quantities (n,), affine in mu; every row is to hold at each of them.
        corrects_input: alpha and beta are part of the input, u = control(mu + alpha mu + beta) [approach1_input].
        reads: further expressions that `look` gives, by name.
        solver: the one that is asked first, `daqp` or `osqp`; the other one is its guard.

    `look`: what can be read, of x and p: `nominal_a`, `nominal_b`, `control_a`, `control_b`, and `reads` by name.
    One object serves one thread. Raises DegreeError for a barrier or CLF of another relative degree than was said,
    ValueError for an expression with an undeclared symbol or two quantities of one name.
    """

    @one_at_a_time
    def __init__(
        self,
        system: System,
        quantities: Sequence[Constrained],
        *,
        control: Affine | None = None,
        limit: Number | None = None,
        constraints: Sequence[Constraint] = (),
        objective: Callable[[Terms], Affine | None] | None = None,
        corners: Callable[[Terms], list[Affine]] | None = None,
        corrects_input: bool = False,
        reads: Symbols | None = None,
        solver: str = "daqp",
    ) -> None:
        self.system, self.terms = system, Terms(system, quantities, control)
        terms, self.names = copy(self.terms), self.terms.names
        if corrects_input:
            cases = [terms.nominal]
            terms.control = terms.control.after(Affine.identity(terms.inputs) + terms.estimates)
        else:
            value = terms.nominal + terms.estimates
            cases = [value + corner for corner in corners(terms)] if corners else [value]
        rows = [block for case in cases for block in terms.rows(case)]
        rows += [block for constraint in constraints for block in constraint(terms)]
        self.cases, self.limits = len(cases), 0 if limit is None else system.u.numel()  # how many; of rows, the last
        if limit is not None:  # the mu that gives u = 0 always meets these
            names, a, b = tuple(f"u{i + 1}" for i in range(system.u.numel())), terms.control.a, terms.control.b
            rows.append(Rows(names, a, -limit - b, limit - b))
        self.layout, data = build_qp(rows, objective(terms) if objective else None, terms.control)
        self.needs_output_error = ca.depends_on(packed(data), ca.vec(terms.symbols["output_error"]))
        data["is_valid"] *= is_bounded(packed(terms.symbols))
        self.data, self.answer = data, Answering(terms.symbols, data, self.layout, solver)
        self.reset = self.answer.reset  # forgets the last programme, so that no episode depends on the one before
        nominal, control = self.terms.nominal, self.terms.control
        self.reads = {"nominal_a": nominal.a, "control_a": control.a, "nominal_b": nominal.b, "control_b": control.b}
        self.reads |= {name: value for quantity in terms.quantities for name, value in quantity.reads.items()}
        self.reads |= reads or {}
        self.look = NumpyFunction.of("look", {"x": system.x, "p": system.p}, self.reads, MATRICES)
        self._places, self._size, self._nothing = places_of(system.named), system.p.numel(), self.no_error()

    def __call__(
        self, x: Any, alpha: Any = None, beta: Any = None, output_error: Any = None, **parameters: Any
    ) -> Decided:
        """The tick at a state `x` (n,), with a value for each parameter of the system. Estimates not given are zero.

        Raises ValueError where a parameter is missing or unknown, or a value is not finite or of the wrong size.
        """
        estimates = None
        if not (alpha is None and beta is None and output_error is None):
            given = zip((alpha, beta, output_error), vars(self._nothing).values(), strict=True)
            estimates = Estimates(*(zero if value is None else np.asarray(value, float) for value, zero in given))
        return self.decide(np.asarray(x, float), self.p(**parameters), estimates)

    def decide(self, x: Array, p: Array, estimates: Estimates | None = None) -> Decided:
        """The tick, of a nominal controller without estimates.

        Raises ValueError where a value is not finite or of the wrong size, or an output error is needed and not known.
        """
        inputs = (x, p) if estimates is None else self._inputs(x, p, estimates)
        decided = self.answer(*inputs)
        if not decided.solved:
            named = {"x": x, **{name: p[place] for name, (place, _) in self._places.items()}}
            named |= dict(zip(("alpha", "beta", "output_error"), inputs[2:], strict=False))
            for name, value in named.items():
                if not np.isfinite(value).all():
                    raise ValueError(f"{name} = {value}: expected finite numbers")
        return decided

    def programme(self, x: Array, p: Array, estimates: Estimates) -> Values:
        """The data of the QP, see `qp.build_qp`; for who solves it in another way."""
        return self.answer.programme(*self._inputs(x, p, estimates))

    def p(self, **parameters: Any) -> Array:
        """All parameters as one array, for `decide`; raises ValueError where one is missing, unknown or too long."""
        row, places = np.empty(self._size), self._places
        if parameters.keys() != places.keys():
            missing, unknown = places.keys() - parameters.keys(), parameters.keys() - places.keys()
            problem = f"{', '.join(sorted(missing))} missing" if missing else f"{', '.join(sorted(unknown))} unknown"
            raise ValueError(f"parameters: {problem}; expected {', '.join(places) or 'none'}")
        for name, (place, shape) in places.items():
            value = parameters[name]
            try:
                if shape == (1,):
                    row[place.start] = value if isinstance(value, float) else np.asarray(value, float).item()
                elif (value := np.asarray(value, float)).shape == shape:
                    row[place] = value if len(shape) == 1 else value.ravel()
                else:
                    raise ValueError
            except (TypeError, ValueError):
                raise ValueError(f"parameter {name} = {value}: expected numbers of shape {shape}") from None
        return row

    def no_error(self) -> Estimates:
        """The estimates of a nominal controller."""
        return Estimates.zero(len(self.names), self.terms.inputs)

    def _inputs(self, x: Array, p: Array, estimates: Estimates) -> tuple[Array, ...]:
        """The functions' inputs; an output error that is not known is zero where nothing depends on it."""
        if estimates.output_error is not None:
            return x, p, estimates.alpha, estimates.beta, estimates.output_error
        if self.needs_output_error:
            raise ValueError("output_error = None: expected (Delta_2 | Delta_1), on which the objective depends")
        return x, p, estimates.alpha, estimates.beta
