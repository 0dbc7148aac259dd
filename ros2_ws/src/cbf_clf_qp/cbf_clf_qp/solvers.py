"""Solvers behind one small interface. An answer counts only if the solver says so and its KKT residuals agree.

For min x'x + q'x, lower <= A x <= upper with multipliers y:  2 x + q + A'y = 0, lower <= A x <= upper.
"""

import io
import math
import sys
import time
from typing import ClassVar, NamedTuple, Protocol

import daqp
import numpy as np
import osqp
from scipy import sparse

from cbf_clf_qp.affine import Array
from cbf_clf_qp.qp import UNBOUNDED, Layout, QuadraticProgram

TOLERANCE = 1e-4  # KKT residual that is let pass, relative to the size of x


class Solution(NamedTuple):
    """`x` (n,), trustworthy only if `solved`; the solver's own `status`; `residual`, the larger KKT residual."""

    x: Array
    solved: bool
    status: str
    solver: str
    residual: float
    seconds: float


class Solver(Protocol):
    """Solves one programme a tick."""

    def solve(self, qp: QuadraticProgram) -> Solution: ...

    def reset(self) -> None:
        """Forget the last programme, so that an episode does not depend on the one before."""


class _Nowhere(io.StringIO):
    """A stdout for a library that prints whatever one asks of it."""

    def write(self, text: str) -> int:
        """Drop it."""
        return len(text)


class OsqpSolver:
    """OSQP, set up once for the controller's sparsity pattern and updated at every tick."""

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

    def solve(self, qp: QuadraticProgram) -> Solution:
        """Solve. If the programme has another layout than the last one, set the solver up first."""
        start = time.perf_counter()
        if qp.layout is self._layout:
            self._solver.update_data_vec(q=qp.q, l=qp.lower, u=qp.upper)
            self._solver.update_data_mat(P_x=None, P_i=None, A_x=qp.A.ravel()[qp.layout.order], A_i=None)
        else:
            self._set_up(qp)
        stdout, sys.stdout = sys.stdout, self._nowhere  # "Polishing not needed", also when not verbose
        try:
            self._solver.solve()
        finally:
            sys.stdout = stdout
        solution, status = self._solver.solution, self._solver.info.status
        x = solution.x  # a copy
        residual = kkt_residual(qp, x, solution.y) if status == "solved" else np.inf
        elapsed = time.perf_counter() - start
        return Solution(x, residual < TOLERANCE, status, self.name, residual, elapsed)

    def _set_up(self, qp: QuadraticProgram) -> None:
        order, (rows, columns) = qp.layout.order, qp.A.shape
        A = sparse.csc_matrix((qp.A.ravel()[order], np.divmod(order, columns)), shape=(rows, columns))
        P = sparse.eye(columns, format="csc") * 2
        problem = osqp.OSQP()
        problem.setup(P, qp.q, A, qp.lower, qp.upper, **self.SETTINGS)
        self._solver = problem._solver  # the compiled one: its wrapper costs a tick as much as solving does
        self._layout = qp.layout


class DaqpSolver:
    """DAQP, a dual active-set solver: exact, small and dense; the peer of the tests and the guard of OSQP."""

    name = "daqp"

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """The next programme is of a new layout."""
        self._layout: Layout | None = None

    def solve(self, qp: QuadraticProgram) -> Solution:
        """Solve from scratch."""
        start = time.perf_counter()
        if qp.layout is not self._layout:
            self._layout, self._hessian = qp.layout, 2 * np.eye(qp.q.size)
            self._sense = np.zeros(len(qp.upper), dtype=np.int32)
        x, _, flag, info = daqp.solve(self._hessian, qp.q, qp.A, qp.upper, qp.lower, self._sense)
        residual = kkt_residual(qp, x, info["lam"]) if flag > 0 else np.inf
        elapsed = time.perf_counter() - start
        return Solution(x, residual < TOLERANCE, f"exit {flag}", self.name, residual, elapsed)


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

    def solve(self, qp: QuadraticProgram) -> Solution:
        """The first solver's answer, or the guard's."""
        margin, width = np.minimum.reduce(qp.margins, 1).tolist()  # NaN where anything is
        if not (margin >= -UNBOUNDED and width >= 0):
            return Solution(qp.free, False, "bad data", self._first.name, np.inf, 0.0)
        if margin >= 0:
            return Solution(qp.free, True, "unconstrained", self._first.name, 0.0, 0.0)
        solution = self._first.solve(qp)
        if solution.solved:
            return solution
        self.unanswered += 1
        return self._guard.solve(qp)


def kkt_residual(qp: QuadraticProgram, x: Array, y: Array) -> float:
    """The norm of what is violated, stationarity and rows, over 1 + |x|; NaN where `x` is not finite."""
    value, gradient = qp.A.dot(x), y.dot(qp.A)  # of such size `dot` takes half as long as `@`
    violation = value - np.minimum(np.maximum(value, qp.lower), qp.upper)
    gradient += qp.q
    gradient += x
    gradient += x
    return math.sqrt(gradient.dot(gradient) + violation.dot(violation)) / (1 + math.sqrt(x.dot(x)))


def make_solver(name: str) -> GuardedSolver:
    """`osqp` or `daqp`, each guarded by the other."""
    osqp_solver, daqp_solver = OsqpSolver(), DaqpSolver()
    return GuardedSolver(osqp_solver, daqp_solver) if name == "osqp" else GuardedSolver(daqp_solver, osqp_solver)
