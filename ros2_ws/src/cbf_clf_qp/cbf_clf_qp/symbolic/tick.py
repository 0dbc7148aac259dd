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

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from cbf_clf_qp.symbolic.affine import Affine
from cbf_clf_qp.symbolic.functions import Array, NumpyFunction, Values, packed, places_of, split
from cbf_clf_qp.symbolic.objective import Objective
from cbf_clf_qp.symbolic.qp import ROUNDING, Layout, build_qp, reading
from cbf_clf_qp.symbolic.quantity import Constrained
from cbf_clf_qp.symbolic.solvers import Programme, Solver, daqp_in_casadi, make_solver
from cbf_clf_qp.symbolic.system import System
from cbf_clf_qp.symbolic.terms import Constraint, Terms, input_limit

MATRICES = ("nominal_a", "control_a", "A", "unroot")
TOLERANCE = 1e-4  # KKT residual that is let pass, relative to the size of x


def least_mu(terms: Terms) -> None:
    """The paper's objective, mu' mu."""


def no_corners(terms: Terms) -> list[Affine]:
    """The estimates are numbers, and not the corners of a set."""
    return []


@dataclass(frozen=True)
class Estimates:
    """`alpha` (n, m) and `beta` (n,) of n quantities over mu (m,); `output_error` (m, m + 1): (Delta_2 | Delta_1)."""

    alpha: Array
    beta: Array
    output_error: Array


@dataclass(frozen=True)
class Decided:
    """What a tick decides: the input `u` and `mu` (m,), which count only if `solved`; `residual` of the KKT conditions.

    `values` has what else the programme and its answer say.
    """

    values: Values
    layout: Layout
    solved: bool
    solver: str
    status: str

    u = property(lambda self: self.values.u)
    mu = property(lambda self: self.values.mu)
    residual = property(lambda self: float(self.values.residual[0]))

    @property
    def slack(self) -> dict[str, float]:
        """By how much a row gives way, of each that does, by name."""
        slacks = zip(self.layout.names, self.values.slack.tolist(), strict=True)
        return {name: slack for name, slack in slacks if slack > 0}

    @property
    def active(self) -> tuple[str, ...]:
        """Names of the rows that hold with equality."""
        return tuple(np.array(self.layout.names)[self.values.margin < ROUNDING].tolist())


class Tick:
    """The tick of a `system` whose `quantities` are constrained, as functions of x, p and the estimates.

    Args:
        control: u affine in mu. None: that which gives y^(r) = mu where a CLF has as many outputs as there are inputs,
            else u = mu.
        limit: of |u|, hard, on each component; an expression or a number.
        constraints: further rows.
        objective: of the terms; None as its value means mu' mu.
        corners: further errors of the quantities (n,), affine in mu; every row is to hold at each of them.
        corrects_input: alpha and beta are no errors of quantities but a part of the input,
            u = control(mu + alpha mu + beta) [approach1_input].
        reads: further expressions that `look` gives, by name.
        solver: the one that is asked first, `daqp` or `osqp`; the other one is its guard.

    Raises:
        DegreeError: a barrier or CLF of another relative degree than was said.
        ValueError: an expression with an undeclared symbol.

    One object serves one thread.
    """

    def __init__(
        self,
        system: System,
        quantities: Sequence[Constrained],
        *,
        control: Affine | None = None,
        limit: ca.SX | float | None = None,
        constraints: Sequence[Constraint] = (),
        objective: Callable[[Terms], Objective | None] = least_mu,
        corners: Callable[[Terms], list[Affine]] = no_corners,
        corrects_input: bool = False,
        reads: Mapping[str, ca.SX] | None = None,
        solver: str = "daqp",
    ) -> None:
        self.terms = terms = Terms.of(system, quantities, control, reads)
        self.names, self.system = terms.names, system
        if corrects_input:
            corrected = terms.control.after(Affine.identity(terms.inputs) + terms.estimates)
            cases, terms = [terms.nominal], replace(terms, control=corrected)
        else:
            value = terms.nominal + terms.estimates
            cases = [value + corner for corner in corners(terms)] or [value]
        limits = [] if limit is None else [input_limit(limit)]
        rows = [block for case in cases for block in terms.rows(case)]
        rows += [block for constraint in (*constraints, *limits) for block in constraint(terms)]
        self.layout, data = build_qp(rows, objective(terms), terms.inputs)
        self._data = data | {"control_a": terms.control.a, "control_b": terms.control.b}
        self._solvers: tuple[Solver, Solver] = make_solver(solver), make_solver("osqp" if solver == "daqp" else "daqp")
        self._no_error, self._parameters_size = self.no_error(), int(system.p.numel())
        self.unanswered = 0  # ticks that the first solver did not answer

    def __call__(
        self,
        x: Any,
        alpha: Array | None = None,
        beta: Array | None = None,
        output_error: Array | None = None,
        **parameters: Any,
    ) -> Decided:
        """The tick at a state `x` (n,), with a value for each parameter of the system. Estimates not given are zero.

        Raises:
            ValueError: a parameter is missing or unknown, or a value is not finite or of the wrong size.
        """
        no = self._no_error
        given = (alpha, no.alpha), (beta, no.beta), (output_error, no.output_error)
        values = [zero if value is None else value for value, zero in given]
        return self.decide(np.asarray(x, dtype=float), self.p(**parameters), Estimates(*values))

    def no_error(self) -> Estimates:
        """The estimates of a nominal controller, of its own arrays."""
        n, m = len(self.names), self.terms.inputs
        return Estimates(np.zeros((n, m)), np.zeros(n), np.zeros((m, m + 1)))

    def p(self, **parameters: Any) -> Array:
        """All parameters as one array, for `decide`; raises ValueError where one is missing, unknown or too long."""
        places = self._parameter_places
        if parameters.keys() != places.keys():
            missing, unknown = places.keys() - parameters.keys(), parameters.keys() - places.keys()
            problem = f"{', '.join(sorted(missing))} missing" if missing else f"{', '.join(sorted(unknown))} unknown"
            raise ValueError(f"parameters: {problem}; expected {', '.join(places) or 'none'}")
        row = np.empty(self._parameters_size)
        for name, value in parameters.items():
            place, shape = places[name]
            try:
                row[place] = value if shape == (1,) else np.reshape(value, shape).ravel()
            except (TypeError, ValueError):
                raise ValueError(f"parameter {name} = {value}: expected numbers of shape {shape}") from None
        return row

    def decide(self, x: Array, p: Array, estimates: Estimates) -> Decided:
        """The tick; raises ValueError where a value is not finite."""
        inputs = x, p, estimates.alpha, estimates.beta, estimates.output_error
        first, guard = self._solvers
        decided = self._inside(inputs) if first.name == "daqp" else self._outside(inputs, first)
        if decided.solved:
            return decided
        self._check_finite(inputs)
        self.unanswered += 1
        return self._outside(inputs, guard)

    def reset(self) -> None:
        """Forget the last programme, so that an episode does not depend on the one before."""
        for solver in self._solvers:
            solver.reset()

    def look(self, x: Array, p: Array) -> Values:
        """What can be read of a state: `nominal_a`, `nominal_b`, `control_a`, `control_b`, and `reads` by name."""
        return self._look(x, p)

    def _inside(self, inputs: Sequence[Array]) -> Decided:
        """With DAQP inside the function."""
        values = self._decided(*inputs)
        return Decided(values, self.layout, self._is_solved(values), "daqp", "in the function")

    def _outside(self, inputs: Sequence[Array], solver: Solver) -> Decided:
        """With a solver of its own, between two functions."""
        data = self._programme(*inputs)
        answer = solver.solve(Programme(data.q, data.lower, data.upper, data.A, self.layout))
        values = self._reading(data.row, answer.x, answer.y)
        solved = answer.has_answer and self._is_solved(values)
        return Decided(values, self.layout, solved, solver.name, answer.status)

    def _is_solved(self, values: Values) -> bool:
        return bool(values.residual[0] < TOLERANCE and values.is_valid[0])

    def _check_finite(self, inputs: Sequence[Array]) -> None:
        names = ("x", "p", "alpha", "beta", "output_error")
        for name, value in zip(names, inputs, strict=True):
            if not np.isfinite(value).all():
                wrong = [k for k, (place, _) in self._parameter_places.items() if not np.isfinite(value[place]).all()]
                name, value = (wrong[0], value[self._parameter_places[wrong[0]][0]]) if name == "p" else (name, value)
                raise ValueError(f"{name} = {value}: expected finite numbers")

    @cached_property
    def _parameter_places(self) -> dict[str, Any]:
        return places_of(self.system.named)

    @property
    def _of_state(self) -> dict[str, ca.SX]:
        return {"x": self.system.x, "p": self.system.p}

    @property
    def _inputs(self) -> dict[str, ca.SX]:
        error = ca.horzcat(self.terms.output_error.a, self.terms.output_error.b)
        estimates = {"alpha": self.terms.estimates.a, "beta": self.terms.estimates.b, "output_error": error}
        return self._of_state | estimates

    @cached_property
    def _look(self) -> NumpyFunction:
        terms = self.terms
        of_model = {"nominal_a": terms.nominal.a, "nominal_b": terms.nominal.b}
        of_model |= {"control_a": terms.control.a, "control_b": terms.control.b}
        return NumpyFunction.of("look", self._of_state, {**of_model, **terms.reads}, MATRICES)

    @cached_property
    def _programme(self) -> NumpyFunction:
        return NumpyFunction.of("programme", self._inputs, self._data, MATRICES)

    @cached_property
    def _reading(self) -> NumpyFunction:
        """Of a programme's row and an answer; its outputs have the programme's data too."""
        row = ca.SX.sym("row", packed(self._data).numel())
        x, y = ca.SX.sym("x", self.layout.shape[1]), ca.SX.sym("y", self.layout.shape[0])
        data = split(row, places_of(self._data))
        control = Affine(data["control_a"], data["control_b"])
        return NumpyFunction.of("reading", {"row": row, "x": x, "y": y}, reading(data, control, x, y, self.layout))

    @cached_property
    def _decided(self) -> NumpyFunction:
        """Programme, DAQP and reading in one function."""
        programme, read = self._programme.function, self._reading.function
        inputs = [ca.MX.sym(programme.name_in(i), programme.sparsity_in(i)) for i in range(programme.n_in())]
        row = programme(*inputs)
        data = split(row, places_of(self._data))
        x, y = daqp_in_casadi(self.layout, data["q"], data["A"], data["lower"], data["upper"])
        return NumpyFunction(ca.Function("decided", inputs, [read(row, x, y)]), self._reading.places)
