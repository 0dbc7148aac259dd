"""Solvers behind one small interface. An answer counts only if the solver says so and its KKT residuals agree.

For min x'x + q'x, lower <= A x <= upper with multipliers y:  2 x + q + A'y = 0, lower <= A x <= upper.
"""

import io
import signal
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, cast

import daqp
import numpy as np
import osqp
from scipy import sparse

from cbf_clf_qp.affine import Array
from cbf_clf_qp.qp import Layout, QuadraticProgram
from cbf_clf_qp.symbols import larger, smaller

TOLERANCE = 1e-4  # KKT residual that is let pass, relative to the size of x


@dataclass
class Solution:
    """`x` (n,), trustworthy only if `solved`; the solver's own `status`; `residual`, the KKT residual, inf without an
    answer; `read`, what was read of the answer.
    """

    x: Array
    solved: bool
    status: str
    solver: str
    residual: float
    seconds: float
    read: Sequence[Any] = ()


Reading = Callable[[QuadraticProgram, Array, Array], Sequence[Any]]  # of an answer x and y: its KKT residual, and more


class Solver(Protocol):
    """Solves one programme a tick, and reads the answer."""

    def solve(self, qp: QuadraticProgram, read: Reading) -> Solution: ...

    def reset(self) -> None:
        """Forget the last programme, so that an episode does not depend on the one before."""


def residual_of(qp: QuadraticProgram, x: Array, y: Array) -> Sequence[Any]:
    """All that a reading has to say."""
    return [kkt_residual(qp, x, y)]


class _Nowhere(io.StringIO):
    """A stdout for a library that prints whatever one asks of it."""

    def write(self, text: str) -> int:
        """Drop it."""
        return len(text)


class OsqpSolver:
    """OSQP, set up once for the controller's sparsity pattern and updated at every tick.

    While it solves, OSQP answers SIGINT itself: it stops, and nobody else hears of the signal. So a Ctrl-C waits until
    the programme is solved. If another thread took the signal, it is raised again and the programme is solved again.
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

    def __init__(self) -> None:
        self._nowhere = _Nowhere()
        self.reset()

    def reset(self) -> None:
        """The next programme sets the solver up anew: no warm start."""
        self._layout: Layout | None = None

    def solve(self, qp: QuadraticProgram, read: Reading = residual_of) -> Solution:
        """Solve. If the programme has another layout than the last one, set the solver up first."""
        start = time.perf_counter()
        if qp.layout is self._layout:
            self._solver.update_data_vec(qp.q, qp.lower, qp.upper)
            self._solver.update_data_mat(None, None, qp.entries, None)
        else:
            self._set_up(qp)
        while self._status() == "interrupted":
            signal.raise_signal(signal.SIGINT)
        solution, status = self._solver.solution, self._solver.info.status
        x = solution.x  # a copy
        found = read(qp, x, solution.y)
        residual = found[0] if status == "solved" else np.inf
        return Solution(x, residual < TOLERANCE, status, self.name, residual, time.perf_counter() - start, found)

    def _status(self) -> str:
        """Solve; return the solver's status."""
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        stdout, sys.stdout = sys.stdout, self._nowhere  # "Polishing not needed", also when not verbose
        try:
            self._solver.solve()
        finally:
            sys.stdout = stdout
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        return str(self._solver.info.status)

    def _set_up(self, qp: QuadraticProgram) -> None:
        rows, columns = qp.A.shape
        A = sparse.csc_matrix((qp.entries, np.divmod(qp.layout.order, columns)), shape=(rows, columns))
        P = sparse.eye(columns, format="csc") * 2
        problem = osqp.OSQP()
        problem.setup(P, qp.q, A, qp.lower, qp.upper, **self.SETTINGS)
        self._solver = problem._solver  # the compiled one: its wrapper costs a tick as much as solving does
        self._layout = qp.layout


class DaqpSolver:
    """DAQP, a dual active-set solver: exact, small and dense; the peer of the tests and the guard of OSQP.

    Set up once for a layout and updated at every tick; `sense` 0 at each forgets the last active set.
    """

    name = "daqp"

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
        residual = found[0] if flag > 0 else np.inf
        seconds = time.perf_counter() - start
        return Solution(x, residual < TOLERANCE, f"exit {flag}", self.name, residual, seconds, found)

    def answer(self, q: Array, A: Array, upper: Array, lower: Array, layout: Layout) -> tuple[Array, int, Array]:
        """x, DAQP's exit flag, positive where it has an answer, and the multipliers."""
        if layout is self._layout:
            failed = self._model.update(None, q, A, upper, lower, self._sense)
        else:
            self._model, self._layout = daqp.Model(), layout
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
            residual = 0.0 if is_valid else np.inf
            found = read(qp, qp.free, np.zeros(len(qp.upper)))
            return Solution(qp.free, bool(is_valid), status, self._first.name, residual, 0.0, found)
        solution = self._first.solve(qp, read)
        if solution.solved:
            return solution
        self.unanswered += 1
        return self._guard.solve(qp, read)


def kkt_residual(qp: QuadraticProgram, x: Array, y: Array) -> float:
    """The norm of what is violated, stationarity and rows, over 1 + |x|; NaN where `x` is not finite."""
    value, gradient = qp.A @ x, 2 * x + qp.q + y @ qp.A
    violation = value - smaller(larger(value, qp.lower), qp.upper)
    return cast(float, np.sqrt(gradient @ gradient + violation @ violation) / (1 + np.sqrt(x @ x)))


def make_solver(name: str) -> GuardedSolver:
    """`osqp` or `daqp`, each guarded by the other."""
    osqp_solver, daqp_solver = OsqpSolver(), DaqpSolver()
    return GuardedSolver(osqp_solver, daqp_solver) if name == "osqp" else GuardedSolver(daqp_solver, osqp_solver)
