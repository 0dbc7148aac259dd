"""The solvers: a programme as a function of a tick's inputs, numbers in, mu and u out.

    min x'x + q'x  subject to  lower <= A x <= upper;  multipliers y are positive at an upper bound

DAQP, a dual active-set method, is exact and starts from nothing at every tick; programme, solver and the reading of its
answer are one CasADi function. OSQP, which starts from its last answer, solves between two. Each solver is the other's
guard: what counts is the KKT residual of an answer, and not what a solver says of it.
"""

import signal
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from time import perf_counter
from typing import Any, ClassVar, Protocol

import casadi as ca
import numpy as np

from cbf_clf_qp.functions import Array, NumpyFunction, Place, Values, free_symbols, one_at_a_time, packed, row_by_row
from cbf_clf_qp.qp import ROUNDING, UNBOUNDED, Layout, reading

SOLVERS = "daqp", "osqp"
TOLERANCE = 1e-6  # KKT residual that is let pass, relative to 1 + |x|, of a hard row to its own bounds
EXACT = 1e-12  # of a row's value, over 1 + |bound|
INVALID = "data not valid"


@dataclass(slots=True)
class Decided:
    """What a tick decides: `mu` (m,) and the input `u`, which count only if `solved`.

    `values`: all that the answer says, see `qp.reading`; `solver`: whose answer it is; `seconds`: of the whole call.
    Of N robots: arrays have a row for each, `solver` and `status` are lists, `seconds` is the mean.
    """

    values: Values
    layout: Layout
    solved: Any  # bool, or (N,)
    solver: Any  # str
    status: Any  # str
    seconds: float

    def __getitem__(self, i: int) -> "Decided":
        """That of robot `i` of N."""
        return Decided(self.values[i], self.layout, self.solved[i], self.solver[i], self.status[i], self.seconds)

    @property
    def u(self) -> Array:
        """The input."""
        return self.values.u

    @property
    def mu(self) -> Array:
        """The auxiliary input (m,)."""
        return self.values.mu

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

    Functions: `programme`, the data of the inputs; `reading`, what an answer says, of (data, x, y); `with_daqp`, both
    with DAQP between them. `solver`: the one that is asked first, `daqp` or `osqp`. Raises ValueError for another one,
    or an unknown symbol.
    """

    @one_at_a_time
    def __init__(self, inputs: Mapping[str, ca.SX], data: Mapping[str, ca.SX], layout: Layout, solver: str) -> None:
        if unknown := free_symbols(packed(data), inputs.values()):
            raise ValueError(f"rows or objective depend on {unknown}: expected {', '.join(inputs)}")
        if solver not in SOLVERS:
            raise ValueError(f"solver = {solver}: expected {' or '.join(SOLVERS)}")
        self.layout, self.solver, self._solvers = layout, solver, guarded(solver)
        self.programme = NumpyFunction.of("programme", inputs, data, matrices=("A", "unroot", "control_a"))
        parts = {name: ca.SX.sym(name, *value.shape) for name, value in data.items()}
        x, y = ca.SX.sym("x", layout.of_A.size2()), ca.SX.sym("y", layout.of_A.size1())
        answer = {"data": packed(parts), "x": x, "y": y}
        self.reading = NumpyFunction.of("reading", answer, reading(parts, x, y, layout), matrices=("control_a",))
        given, names = self.programme.function.mx_in(), self.programme.function.name_in()
        row = self.programme.function(*given)
        values = self.reading.function(row, *by_daqp(row, self.programme.places))
        self.with_daqp = NumpyFunction(ca.Function("decided", given, [values], names, ["values"]), self.reading.places)
        self._osqp = OsqpSolver(layout)
        self.unanswered = 0  # programmes that the first solver did not answer, also where nobody could
        self.reset = self._osqp.reset

    def __call__(self, *inputs: Array) -> Decided:
        """The first solver's answer, or its guard's; `solved` is false where neither has one. Inputs left out are 0."""
        start = perf_counter()
        for solver in self._solvers:
            values, status = (self.with_daqp(*inputs), "solved") if solver == "daqp" else self._by_osqp(*inputs)
            solved = values.row.item(0) < TOLERANCE  # the residual
            if solved:
                break
            self.unanswered += solver == self.solver
            if not values.is_valid[0]:  # nobody can
                status = INVALID
                break
            status = "not solved" if solver == "daqp" else status
        return Decided(values, self.layout, solved, solver, status, perf_counter() - start)

    def _by_osqp(self, *inputs: Array) -> tuple[Values, str]:
        data = self.programme(*inputs)
        x, y, _, status = self._osqp.solve(data)
        return self.reading(data.row, x, y), status


def guarded(solver: str) -> tuple[str, ...]:
    """A solver, and the one that is asked where it has no answer."""
    return SOLVERS if solver == SOLVERS[0] else SOLVERS[::-1]


def by_daqp(data: ca.MX, places: Mapping[str, Place]) -> tuple[ca.MX, ca.MX]:
    """x (n,) and y (k,) as expressions of a programme's data: DAQP inside a CasADi function."""
    rows, columns = places["A"][1]
    q, lower, upper, entries = (data[places[name][0]] for name in ("q", "lower", "upper", "A"))
    hessian, free = 2 * ca.DM.eye(columns), UNBOUNDED * ca.DM.ones(columns)
    shapes = {"h": hessian.sparsity(), "a": ca.Sparsity.dense(rows, columns)}
    solve = ca.conic("daqp", "daqp", shapes, {"error_on_fail": False, "daqp": {"primal_tol": 1e-9}})
    A = row_by_row(entries, columns)
    answer = solve(h=hessian, g=q, a=A, lba=lower, uba=upper, lbx=-free, ubx=free)
    return answer["x"], answer["lam_a"]


class Solver(Protocol):
    """One outside a compiled function."""

    def solve(self, data: Values) -> tuple[Array, Array, float, str]:
        """x (n,), y (k,), the KKT residual up to which they count, and what the solver says, for data of `qp.py`."""

    def reset(self) -> None:
        """Forget the last programme."""


class OsqpSolver:
    """OSQP, set up once for a layout and updated at every tick; it starts from its last answer.

    While it solves, OSQP answers SIGINT itself: it stops, and nobody else hears of the signal. So a Ctrl-C waits until
    the programme is solved. If another thread took the signal, it is raised again and the programme is solved again.
    """

    SETTINGS: ClassVar = {"eps_abs": 1e-6, "eps_rel": 1e-6, "check_termination": 10, "verbose": False}

    def __init__(self, layout: Layout) -> None:
        self._shape = layout.of_A.shape
        self._entries = tuple(map(np.array, layout.of_A.get_triplet()))  # of A, column by column, as OSQP has them
        self.reset()

    def reset(self) -> None:
        """The next programme sets the solver up again: no warm start."""
        self._problem: Any = None

    def solve(self, data: Values) -> tuple[Array, Array, float, str]:
        """See `Solver`."""
        if not data.is_valid[0]:
            return np.zeros(len(data.q)), np.zeros(len(data.upper)), TOLERANCE, INVALID
        entries = data.A[self._entries]
        if self._problem:
            self._problem.update(q=data.q, l=data.lower, u=data.upper, Ax=entries)
        else:
            self._set_up(data, entries)
        while (result := self._solved()).info.status == "interrupted":
            signal.raise_signal(signal.SIGINT)
        return *exact(data, result.x, result.y), TOLERANCE, str(result.info.status)

    def _set_up(self, data: Values, entries: Array) -> None:
        import osqp  # half a second, with scipy
        from scipy import sparse

        A = sparse.csc_matrix((entries, self._entries), shape=self._shape)
        self._problem = osqp.OSQP()
        hessian = sparse.eye(len(data.q), format="csc") * 2
        self._problem.setup(hessian, data.q, A, data.lower, data.upper, **self.SETTINGS)

    def _solved(self) -> Any:
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            return self._problem.solve(raise_error=False)
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)


def exact(data: Values, x: Array, y: Array) -> tuple[Array, Array]:
    """The solution if those rows are active that seem to be at x, y: the x nearest to -q / 2 with A_a x = b."""
    value = data.A @ x
    at_upper = data.upper - value < y
    active = at_upper | (value - data.lower < -y)
    A, y, free = data.A[active], np.zeros(len(y)), -0.5 * data.q
    if not active.any() or not np.isfinite(value).all():
        return free, y
    b, half = np.where(at_upper, data.upper, data.lower)[active], np.zeros(0)
    with suppress(np.linalg.LinAlgError):  # of rows of which one says what others say
        half = np.linalg.solve(A @ A.T, A @ free - b)
        x = free - A.T @ half
    if not half.size or (np.abs(A @ x - b) > EXACT * (1 + np.abs(b))).any():
        x = free + np.linalg.lstsq(A, b - A @ free, rcond=None)[0]
        half = np.linalg.lstsq(A.T, free - x, rcond=None)[0]
    y[active] = 2 * half
    return x, y
