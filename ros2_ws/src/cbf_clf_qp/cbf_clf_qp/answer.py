"""The solvers: a programme as a function of a tick's inputs, numbers in, mu and u out.

    min x'x + q'x  subject to  lower <= A x <= upper;  multipliers y are positive at an upper bound

DAQP, a dual active-set method, is exact and starts from nothing at every tick; programme, solver and the reading of its
answer are one CasADi function. OSQP starts from its last answer and solves between two; what it finds is polished, so
that nothing counts but which rows are active. Mostly they are those of the tick before: OSQP is asked only where these
give no optimum. Each solver is the other's guard: what counts is the KKT residual of an answer, and not what a solver
says of it.
"""

import signal
from collections.abc import Mapping
from copy import copy
from dataclasses import dataclass
from time import perf_counter
from typing import Any, ClassVar

import casadi as ca
import numpy as np

from cbf_clf_qp.functions import Array, NumpyFunction, Place, Values, free_symbols, one_at_a_time, packed
from cbf_clf_qp.qp import ROUNDING, UNBOUNDED, Layout, polished, reading

SOLVERS = "daqp", "osqp"
TOLERANCE = 1e-6  # KKT residual that is let pass, relative to 1 + |x|, of a hard row to its own bounds
OPTIMAL = 1e-12  # one that is rounding alone


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

    def is_by(self, solver: str) -> bool:
        """Whether it is this solver's answer: not its guard's, and not nobody's."""
        return bool(self.solved) and self.solver == solver

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

    Functions: `programme`, the data of the inputs; `reading`, what an answer says, of (data, x, y), `polished_reading`
    what the exact one near it says; `with_daqp`, programme and reading with DAQP between them; `near`, programme and
    polished reading, of (x, y) and the inputs. `solver`: the one that is asked first, `daqp` or `osqp`. Raises
    ValueError for another one, or an unknown symbol.
    """

    @one_at_a_time
    def __init__(self, inputs: Mapping[str, ca.SX], data: Mapping[str, ca.SX], layout: Layout, solver: str) -> None:
        if unknown := free_symbols(packed(data), inputs.values()):
            raise ValueError(f"rows or objective depend on {unknown}: expected {', '.join(inputs)}")
        if solver not in SOLVERS:
            raise ValueError(f"solver = {solver}: expected {' or '.join(SOLVERS)}")
        self.layout, self.solver = layout, solver
        self.programme = NumpyFunction.of("programme", inputs, data, matrices=("A", "unroot", "control_a"))
        parts = {name: ca.SX.sym(name, *value.shape) for name, value in data.items()}
        x, y = ca.SX.sym("x", layout.of_A.size2()), ca.SX.sym("y", layout.of_A.size1())
        answer = {"data": packed(parts), "x": x, "y": y}
        self.reading = NumpyFunction.of("reading", answer, reading(parts, x, y, layout), matrices=("control_a",))
        exact = reading(parts, *polished(parts, x, y, layout), layout)
        self.polished_reading = NumpyFunction.of("polished_reading", answer, exact, matrices=("control_a",))
        given, names = self.programme.function.mx_in(), self.programme.function.name_in()
        row = self.programme.function(*given)
        values = self.reading.function(row, *by_daqp(row, self.programme.places))
        self.with_daqp = NumpyFunction(ca.Function("decided", given, [values], names, ["values"]), self.reading.places)
        last = ca.MX.sym("x", x.numel()), ca.MX.sym("y", y.numel())
        values = self.polished_reading.function(row, *last)
        near = ca.Function("near", [*last, *given], [values], ["last_x", "last_y", *names], ["values"])
        self.near = NumpyFunction(near, self.polished_reading.places)
        self._begin()

    def _begin(self) -> None:
        self._osqp = OsqpSolver(self.layout)
        self.unanswered = 0  # programmes that the first solver did not answer, also where nobody could
        self.reset()

    def reset(self) -> None:
        """Forget the last programme: OSQP sets the next one up again, and no rows are known to be active."""
        self._osqp.reset()
        self._last: tuple[Array, Array] | None = None  # x and y

    def another(self) -> "Answering":
        """One with the same functions and an OSQP of its own, for another robot in the same thread."""
        other = copy(self)
        other._begin()
        return other

    def __call__(self, *inputs: Array) -> Decided:
        """The first solver's answer, or its guard's; `solved` is false where neither has one. Inputs left out are 0."""
        start = perf_counter()
        for solver in SOLVERS if self.solver == "daqp" else reversed(SOLVERS):
            values, status = self._by_daqp(*inputs) if solver == "daqp" else self._by_osqp(*inputs)
            solved = values.row.item(0) < TOLERANCE  # the residual
            if solved:
                break
            self.unanswered += solver == self.solver
            if not values.is_valid[0]:  # nobody can
                break
        return Decided(values, self.layout, solved, solver, status, perf_counter() - start)

    def _by_daqp(self, *inputs: Array) -> tuple[Values, str]:
        values = self.with_daqp(*inputs)
        is_solved = values.row.item(0) < TOLERANCE
        return values, "solved" if is_solved else "not solved" if values.is_valid[0] else "data not valid"

    def _by_osqp(self, *inputs: Array) -> tuple[Values, str]:
        if self._last:
            values = self.near(*self._last, *inputs)
            if values.row.item(0) < OPTIMAL:
                self._last = values.x, values.y
                return values, "solved" if values.y.any() else "unconstrained"
        data = self.programme(*inputs)
        if not data.is_valid[0]:
            return self._by_daqp(*inputs)
        x, y, status = self._osqp.solve(data)
        values = self.polished_reading(data.row, x, y)
        self._last = values.x, values.y
        return values, status


def by_daqp(data: ca.MX, places: Mapping[str, Place]) -> tuple[ca.MX, ca.MX]:
    """x (n,) and y (k,) as expressions of a programme's data: DAQP inside a CasADi function."""
    rows, columns = places["A"][1]
    q, lower, upper, entries = (data[places[name][0]] for name in ("q", "lower", "upper", "A"))
    hessian, free = 2 * ca.DM.eye(columns), UNBOUNDED * ca.DM.ones(columns)
    shapes = {"h": hessian.sparsity(), "a": ca.Sparsity.dense(rows, columns)}
    solve = ca.conic("daqp", "daqp", shapes, {"error_on_fail": False, "daqp": {"primal_tol": 1e-9}})
    A = ca.reshape(entries, columns, rows).T
    answer = solve(h=hessian, g=q, a=A, lba=lower, uba=upper, lbx=-free, ubx=free)
    return answer["x"], answer["lam_a"]


class OsqpSolver:
    """OSQP, set up once for a layout and updated at every tick.

    While it solves, OSQP answers SIGINT itself: it stops, and nobody else hears of the signal. So a Ctrl-C waits until
    the programme is solved. If another thread took the signal, it is raised again and the programme is solved again.
    OSQP's own polishing prints to stdout where no row is active; `qp.polished` does not.
    """

    STEPS: ClassVar = {"scaling": 0, "check_termination": 10, "max_iter": 4000, "adaptive_rho_interval": 50}
    SETTINGS: ClassVar = {"eps_abs": 1e-6, "eps_rel": 1e-6, "eps_prim_inf": 1e-8, "verbose": False, **STEPS}

    def __init__(self, layout: Layout) -> None:
        self._shape = layout.of_A.shape
        self._entries = tuple(map(np.array, layout.of_A.get_triplet()))  # of A, column by column, as OSQP has them
        self.reset()

    def reset(self) -> None:
        """The next programme sets the solver up again: no warm start."""
        self._solver: Any = None

    def solve(self, p: Values) -> tuple[Array, Array, str]:
        """x (n,), y (k,) and what OSQP says; it is not asked where the minimum without rows meets them all."""
        free = p.q * -0.5
        value = p.A @ free
        if (value >= p.lower).all() and (value <= p.upper).all():
            return free, np.zeros(len(p.upper)), "unconstrained"
        if self._solver:
            self._solver.update_data_vec(p.q, p.lower, p.upper)
            self._solver.update_data_mat(None, None, p.A[self._entries], None)
        else:
            self._set_up(p)
        while self._solved() == "interrupted":
            signal.raise_signal(signal.SIGINT)
        solution = self._solver.solution
        return solution.x, solution.y, self._solver.info.status

    def _set_up(self, p: Values) -> None:
        import osqp  # half a second, with scipy
        from scipy import sparse

        A = sparse.csc_matrix((p.A[self._entries], self._entries), shape=self._shape)
        problem = osqp.OSQP()
        problem.setup(sparse.eye(len(p.q), format="csc") * 2, p.q, A, p.lower, p.upper, **self.SETTINGS)
        self._solver = problem._solver  # the compiled one: its wrapper costs a tick as much as solving does

    def _solved(self) -> str:
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            self._solver.solve()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        return str(self._solver.info.status)
