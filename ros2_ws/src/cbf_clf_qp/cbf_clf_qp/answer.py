"""A programme as a function of a tick's inputs: numbers in, mu and u out.

With DAQP the programme, the solver and the reading of its answer are one CasADi function; OSQP solves between two. Each
is the other's guard: what counts is the KKT residual of an answer, and not what a solver says of it.
"""

import time
from collections.abc import Mapping, Sequence
from copy import copy
from dataclasses import dataclass

import casadi as ca
import numpy as np

from cbf_clf_qp.functions import Array, NumpyFunction, Values, built_once, free_symbols, packed, places_of, split
from cbf_clf_qp.qp import ROUNDING, Layout, reading
from cbf_clf_qp.solvers import OsqpSolver, by_daqp

TOLERANCE = 1e-6  # KKT residual that is let pass, relative to 1 + |x|


@dataclass(slots=True)
class Decided:
    """What a tick decides: `mu` (m,) and the input `u`, which count only if `solved`.

    `values`: all that the answer says, see `qp.reading`; `solver`: whose answer it is; `seconds`: of the whole call.
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
        return self.values["u"]

    @property
    def mu(self) -> Array:
        """The auxiliary input (m,)."""
        return self.values["mu"]

    @property
    def slack(self) -> dict[str, float]:
        """By how much a row gives way, of each that does, by name; of several with one name, the most."""
        given = sorted(zip(self.values.slack.tolist(), self.layout.names, strict=True))
        return {name: slack for slack, name in given if slack > 0}

    @property
    def active(self) -> tuple[str, ...]:
        """Names of the rows that hold with equality."""
        margins = zip(self.layout.names, self.values.margin.tolist(), strict=True)
        return tuple(name for name, margin in margins if margin < ROUNDING)


class Answering:
    """The answer to a programme of which the `data`, see `qp.build_qp`, are expressions of `inputs`.

    `solver`: the one that is asked first, `daqp` or `osqp`. Raises ValueError for another one, or an unknown symbol.
    """

    def __init__(self, inputs: Mapping[str, ca.SX], data: Mapping[str, ca.SX], layout: Layout, solver: str) -> None:
        if unknown := free_symbols(packed(data), inputs.values()):
            raise ValueError(f"rows or objective depend on {unknown}: expected {', '.join(inputs)}")
        if solver not in ("daqp", "osqp"):
            raise ValueError(f"solver = {solver}: expected daqp or osqp")
        self._inputs, self._data, self.layout, self.solver = inputs, data, layout, solver
        self._osqp = OsqpSolver()
        self.unanswered = 0  # programmes that the first solver did not answer

    def another(self) -> "Answering":
        """One with the same functions and an OSQP of its own, for another robot in the same thread."""
        _ = self.programme, self.reading, self._with_daqp  # made once, and then shared
        other = copy(self)
        other._osqp, other.unanswered = OsqpSolver(), 0
        return other

    def __call__(self, *inputs: Array) -> Decided:
        """The first solver's answer, or its guard's; `solved` is false where neither has one.

        After the first two inputs, a state and parameters, the others may be left out: they are zero.
        """
        first, guard = self._by_daqp, self._by_osqp
        if self.solver == "osqp":
            first, guard = guard, first
        decided = first(inputs)
        if decided.solved or not decided.values.is_valid[0]:
            return decided
        self.unanswered += 1
        return guard(inputs)

    def reset(self) -> None:
        """Forget the last programme, so that an episode does not depend on the one before."""
        self._osqp.reset()

    def _by_daqp(self, inputs: Sequence[Array]) -> Decided:
        start = time.perf_counter()
        values = self._with_daqp(*inputs) if len(inputs) > 2 else self._of_two(*inputs)
        solved = bool(values.row[0] < TOLERANCE)
        status = "solved" if solved else "not solved" if values.is_valid[0] else "data not valid"
        return Decided(values, self.layout, solved, "daqp", status, time.perf_counter() - start)

    def _by_osqp(self, inputs: Sequence[Array]) -> Decided:
        start = time.perf_counter()
        zeros = [np.zeros(symbol.numel()) for symbol in [*self._inputs.values()][len(inputs) :]]
        data = self.programme(*inputs, *zeros)
        if not data.is_valid[0]:
            return self._by_daqp(inputs)
        x, y, status = self._osqp.solve(data, self.layout)
        values = self.reading(data.row, x, y)
        solved = bool(values.row[0] < TOLERANCE)
        return Decided(values, self.layout, solved, "osqp", status, time.perf_counter() - start)

    @built_once
    def programme(self) -> NumpyFunction:
        return NumpyFunction.of("programme", self._inputs, self._data, matrices=("A", "unroot", "control_a"))

    @built_once
    def reading(self) -> NumpyFunction:
        row = ca.SX.sym("row", packed(self._data).numel())
        x, y = ca.SX.sym("x", self.layout.shape[1]), ca.SX.sym("y", self.layout.shape[0])
        said = reading(split(row, places_of(self._data)), x, y, self.layout)
        return NumpyFunction.of("reading", {"row": row, "x": x, "y": y}, said, matrices=("control_a",))

    @built_once
    def solving(self) -> NumpyFunction:
        """DAQP alone: x and y of a programme's row."""
        row = ca.MX.sym("row", packed(self._data).numel())
        x, y = by_daqp(split(row, places_of(self._data)), self.layout)
        columns, rows = self.layout.shape[1], self.layout.shape[0]
        places = {"x": (slice(0, columns), (columns,)), "y": (slice(columns, columns + rows), (rows,))}
        return NumpyFunction(ca.Function("solving", [row], [ca.vertcat(x, y)], ["row"], ["answer"]), places)

    @built_once
    def _with_daqp(self) -> NumpyFunction:
        programme, read = self.programme.function, self.reading.function
        inputs = [ca.MX.sym(programme.name_in(i), programme.sparsity_in(i)) for i in range(programme.n_in())]
        row = programme(*inputs)
        x, y = by_daqp(split(row, places_of(self._data)), self.layout)
        function = ca.Function("decided", inputs, [read(row, x, y)], programme.name_in(), ["values"])
        return NumpyFunction(function, self.reading.places)

    @built_once
    def _of_two(self) -> NumpyFunction:
        return NumpyFunction(self._with_daqp.function, self.reading.places, inputs=2)
