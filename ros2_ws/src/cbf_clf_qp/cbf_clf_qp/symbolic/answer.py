"""A programme as a function of a tick's inputs: numbers in, mu and u out.

With DAQP the programme, the solver and the reading of its answer are one CasADi function. OSQP solves between two
functions. Each solver guards the other: what counts is the KKT residual of an answer, and not what a solver says of it.
"""

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import casadi as ca

from cbf_clf_qp.symbolic.functions import Array, NumpyFunction, Values, free_symbols, packed, places_of, split
from cbf_clf_qp.symbolic.qp import ROUNDING, Layout, reading
from cbf_clf_qp.symbolic.solvers import Solver, daqp_in_casadi, make_solver

TOLERANCE = 1e-6  # KKT residual that is let pass, relative to 1 + |x|


@dataclass(slots=True)
class Decided:
    """What a tick decides: `mu` (m,) and the input `u`, which count only if `solved`.

    `values`: all that the answer says, see `qp.reading`; `seconds`: of the whole call.
    """

    values: Values
    layout: Layout
    solved: bool
    solver: str
    status: str
    seconds: float

    @property
    def u(self) -> Array:
        """The input."""
        return self.values.u

    @property
    def mu(self) -> Array:
        """The auxiliary input (m,)."""
        return self.values.mu

    @property
    def residual(self) -> float:
        """How far the answer is from the KKT conditions, over 1 + |x|; inf where the data are not valid."""
        return float(self.values.residual[0])

    @property
    def slack(self) -> dict[str, float]:
        """By how much a row gives way, of each that does, by name; of several with one name, the most."""
        found: dict[str, float] = {}
        for name, slack in zip(self.layout.names, self.values.slack.tolist(), strict=True):
            if slack > 0:
                found[name] = max(slack, found.get(name, 0.0))
        return found

    @property
    def active(self) -> tuple[str, ...]:
        """Names of the rows that hold with equality."""
        margins = zip(self.layout.names, self.values.margin.tolist(), strict=True)
        return tuple(name for name, margin in margins if margin < ROUNDING)


class Answering:
    """The answer to a programme of which the `data`, see `qp.build_qp`, are expressions of `inputs`.

    Args:
        solver: the one that is asked first, `daqp` or `osqp`; the other one is its guard.
    """

    def __init__(self, inputs: Mapping[str, ca.SX], data: Mapping[str, ca.SX], layout: Layout, solver: str) -> None:
        if unknown := free_symbols(packed(data), inputs.values()):
            raise ValueError(f"rows or objective depend on {unknown}: expected {', '.join(inputs)}")
        self.layout, self._inputs, self._data = layout, inputs, data
        self._solvers: tuple[Solver, Solver] = make_solver(solver), make_solver("osqp" if solver == "daqp" else "daqp")
        self.unanswered = 0  # programmes that the first solver did not answer

    def __call__(self, *inputs: Array) -> Decided:
        """The first solver's answer, or its guard's; `solved` is false where neither has one."""
        first, guard = self._solvers
        decided = self._inside(inputs) if first.name == "daqp" else self._outside(inputs, first)
        if decided.solved:
            return decided
        if not decided.values.is_valid[0]:
            decided.status = "data not valid"
            return decided
        self.unanswered += 1
        return self._outside(inputs, guard)

    def reset(self) -> None:
        """Forget the last programme, so that an episode does not depend on the one before."""
        for solver in self._solvers:
            solver.reset()

    def _inside(self, inputs: Sequence[Array]) -> Decided:
        """With DAQP in the function."""
        start = time.perf_counter()
        values = self._with_daqp(*inputs)
        solved = bool(values.row[0] < TOLERANCE)
        return Decided(values, self.layout, solved, "daqp", "in the function", time.perf_counter() - start)

    def _outside(self, inputs: Sequence[Array], solver: Solver) -> Decided:
        """With a solver between two functions."""
        start = time.perf_counter()
        data = self._programme(*inputs)
        if not data.is_valid[0]:
            return self._inside(inputs)
        x, y, status = solver.solve(data, self.layout)
        values = self._reading(data.row, x, y)
        solved = bool(values.row[0] < TOLERANCE)
        return Decided(values, self.layout, solved, solver.name, status, time.perf_counter() - start)

    @cached_property
    def _programme(self) -> NumpyFunction:
        return NumpyFunction.of("programme", self._inputs, self._data, matrices=("A", "unroot", "control_a"))

    @cached_property
    def _reading(self) -> NumpyFunction:
        row = ca.SX.sym("row", packed(self._data).numel())
        x, y = ca.SX.sym("x", self.layout.shape[1]), ca.SX.sym("y", self.layout.shape[0])
        said = reading(split(row, places_of(self._data)), x, y, self.layout)
        return NumpyFunction.of("reading", {"row": row, "x": x, "y": y}, said, matrices=("control_a",))

    @cached_property
    def _with_daqp(self) -> NumpyFunction:
        programme, read = self._programme.function, self._reading.function
        inputs = [ca.MX.sym(programme.name_in(i), programme.sparsity_in(i)) for i in range(programme.n_in())]
        row = programme(*inputs)
        data = split(row, places_of(self._data))
        x, y = daqp_in_casadi(self.layout, data["q"], data["A"], data["lower"], data["upper"])
        function = ca.Function("decided", inputs, [read(row, x, y)], programme.name_in(), ["values"])
        return NumpyFunction(function, self._reading.places)
