"""Solvers behind one small interface. An answer counts only if the solver says so and its KKT residuals agree.

For min x'x + q'x, lower <= A x <= upper with multipliers y:  2 x + q + A'y = 0, lower <= A x <= upper. The rows are
judged more strictly than the gradient: a hard row is a promise, and its bounds may lie close together.
"""

import signal
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol

import daqp
import numpy as np
import osqp
from scipy import sparse

from cbf_clf_qp.affine import Array
from cbf_clf_qp.qp import UNBOUNDED, Layout, QuadraticProgram
from cbf_clf_qp.symbols import at_least, larger, smaller

GRADIENT_TOLERANCE = 1e-4  # relative to the size of x
ROW_TOLERANCE = 1e-6  # of the distance between a row's bounds, or of the size of x where that is smaller
CLOSEST = 1e-6  # of the size of x: bounds closer to each other, as those of an equality, count as so far apart


@dataclass
class Solution:
    """`x` (n,), trustworthy only if `solved`; the solver's own `status`; `read`, what was read of the answer."""

    x: Array
    solved: bool
    status: str
    solver: str
    seconds: float
    read: Sequence[Any] = ()


Reading = Callable[[QuadraticProgram, Array, Array], Sequence[Any]]  # of an answer x and y: its KKT residuals, and more


class Solver(Protocol):
    """Solves one programme a tick, and reads the answer."""

    def solve(self, qp: QuadraticProgram, read: Reading) -> Solution: ...

    def reset(self) -> None:
        """Forget the last programme, so that an episode does not depend on the one before."""


def residual_of(qp: QuadraticProgram, x: Array, y: Array) -> Sequence[Any]:
    """All that a reading has to say."""
    return [kkt_residuals(qp, x, y)]


class OsqpSolver:
    """OSQP, set up once for the controller's sparsity pattern and updated at every tick.

    While it solves, OSQP answers SIGINT itself: it stops, and nobody else hears of the signal. So a Ctrl-C waits until
    the programme is solved. If another thread took the signal, it is raised again and the programme is solved again.

    Where no row is active OSQP prints that it need not polish, whatever `verbose` is. So it gets one more variable
    t, of cost t^2 - ACTIVE t, with the row t <= 0, which is always active.
    """

    name = "osqp"
    SETTINGS: ClassVar[dict[str, object]] = {
        "scaling": 0,
        "eps_abs": 1e-6,
        "eps_rel": 1e-6,
        "eps_prim_inf": 1e-8,
        "polishing": True,
        "check_termination": 10,
        "max_iter": 4000,
        "verbose": False,
        "adaptive_rho_interval": 50,
    }
    ACTIVE = 1e-6

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """The next programme sets the solver up anew: no warm start."""
        self._layout: Layout | None = None

    def solve(self, qp: QuadraticProgram, read: Reading = residual_of) -> Solution:
        """Solve. If the programme has another layout than the last one, set the solver up first."""
        start = time.perf_counter()
        if qp.layout is self._layout:
            for own, given in zip(self._data, (qp.q, qp.lower, qp.upper, qp.entries), strict=True):
                own[:-1] = given
            q, lower, upper, entries = self._data
            self._solver.update_data_vec(q, lower, upper)
            self._solver.update_data_mat(None, None, entries, None)
        else:
            self._set_up(qp)
        while self._status() == "interrupted":
            signal.raise_signal(signal.SIGINT)
        solution, status = self._solver.solution, self._solver.info.status
        x = solution.x[:-1]  # of a copy
        found = read(qp, x, solution.y[:-1])
        solved = status == "solved" and is_exact(found)
        return Solution(x, solved, status, self.name, time.perf_counter() - start, found)

    def _status(self) -> str:
        """Solve; return the solver's status."""
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            self._solver.solve()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        return str(self._solver.info.status)

    def _set_up(self, qp: QuadraticProgram) -> None:
        rows, columns = qp.A.shape
        last = (qp.q, -self.ACTIVE), (qp.lower, -UNBOUNDED), (qp.upper, 0.0), (qp.entries, 1.0)
        self._data = tuple(np.append(given, value) for given, value in last)
        q, lower, upper, entries = self._data
        places = [np.append(*each) for each in zip(np.divmod(qp.layout.order, columns), (rows, columns), strict=True)]
        A = sparse.csc_matrix((entries, places), shape=(rows + 1, columns + 1))
        problem = osqp.OSQP()
        problem.setup(sparse.eye(columns + 1, format="csc") * 2, q, A, lower, upper, **self.SETTINGS)
        self._solver = problem._solver  # the compiled one: its wrapper costs a tick as much as solving does
        self._layout = qp.layout


class DaqpSolver:
    """DAQP, a dual active-set solver: exact, small and dense; the peer of the tests and the guard of OSQP.

    Set up once for a layout and updated at every tick; `sense` 0 at each forgets the last active set.
    """

    name = "daqp"
    PRIMAL_TOLERANCE = 1e-9  # of a row of norm one

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """The next programme is of a new layout."""
        self._layout: Layout | None = None
        self._model, self._sense = daqp.Model(), np.zeros(0, dtype=np.int32)

    def solve(self, qp: QuadraticProgram, read: Reading = residual_of) -> Solution:
        """Solve. If the programme has another layout than the last one, set the solver up first."""
        start = time.perf_counter()
        x, flag, y = self.answer(qp.q, qp.A, qp.upper, qp.lower, qp.layout)
        found = read(qp, x, y)
        solved = flag > 0 and is_exact(found)
        return Solution(x, solved, f"exit {flag}", self.name, time.perf_counter() - start, found)

    def answer(self, q: Array, A: Array, upper: Array, lower: Array, layout: Layout) -> tuple[Array, int, Array]:
        """x, DAQP's exit flag, positive where it has an answer, and the multipliers."""
        if layout is self._layout:
            failed = self._model.update(None, q, A, upper, lower, self._sense)
        else:
            self._model, self._layout = daqp.Model(), layout
            self._model.settings = {**self._model.settings, "primal_tol": self.PRIMAL_TOLERANCE}
            self._sense = np.zeros(len(upper), dtype=np.int32)
            failed, _ = self._model.setup(2 * np.eye(q.size), q, A, upper, lower, self._sense)
        x, _, flag, info = self._model.solve()
        return x, failed if failed < 0 else flag, info["lam"]


class GuardedSolver:
    """A first solver and the one that answers in its stead when it does not; `unanswered` counts those ticks.

    Two programmes need no solver: one with bad data is refused, and one whose unconstrained minimum meets every row
    is answered by it (OSQP cannot polish where no row is active).
    """

    def __init__(self, first: OsqpSolver | DaqpSolver, guard: OsqpSolver | DaqpSolver) -> None:
        self._first, self._guard = first, guard
        self.unanswered = 0

    def reset(self) -> None:
        """Reset both; the count goes on."""
        self._first.reset()
        self._guard.reset()

    def solve(self, qp: QuadraticProgram, read: Reading = residual_of) -> Solution:
        """The first solver's answer, or the guard's."""
        is_valid, is_free = qp.checks.tolist()
        if not (is_valid and not is_free):
            status = "unconstrained" if is_valid else "bad data"
            found = read(qp, qp.free, np.zeros(len(qp.upper)))
            return Solution(qp.free, bool(is_valid), status, self._first.name, 0.0, found)
        solution = self._first.solve(qp, read)
        if solution.solved:
            return solution
        self.unanswered += 1
        return self._guard.solve(qp, read)


def kkt_residuals(qp: QuadraticProgram, x: Array, y: Array) -> Array:
    """(2,): the norm of the gradient 2 x + q + A'y, and that of the rows' violations, each relative to what the
    tolerances say; NaN where `x` is not finite.
    """
    value, gradient, size = qp.A @ x, 2 * x + qp.q + y @ qp.A, 1 + np.sqrt(x @ x)
    violation = (value - smaller(larger(value, qp.lower), qp.upper)) / size
    violation = violation / -at_least(-at_least((qp.upper - qp.lower) / size, CLOSEST), -1.0)
    return np.array([np.sqrt(gradient @ gradient) / size, np.sqrt(violation @ violation)])


def is_exact(found: Sequence[Any]) -> bool:
    """Whether an answer's KKT residuals, the first thing that is read of it, are within the tolerances."""
    gradient, rows = found[0].tolist()
    return bool(gradient < GRADIENT_TOLERANCE and rows < ROW_TOLERANCE)


def make_solver(name: str) -> GuardedSolver:
    """`osqp` or `daqp`, each guarded by the other."""
    osqp_solver, daqp_solver = OsqpSolver(), DaqpSolver()
    return GuardedSolver(osqp_solver, daqp_solver) if name == "osqp" else GuardedSolver(daqp_solver, osqp_solver)
