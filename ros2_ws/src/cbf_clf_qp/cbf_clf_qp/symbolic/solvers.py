"""QP solvers behind one small interface, for  min x'x + q'x  subject to  lower <= A x <= upper.

What a solver says of its own answer does not count: `tick.py` asks for the KKT residual.
"""

import signal
import time
from dataclasses import dataclass
from typing import ClassVar, Protocol

import casadi as ca
import daqp
import numpy as np
import osqp
from scipy import sparse

from cbf_clf_qp.symbolic.functions import Array
from cbf_clf_qp.symbolic.qp import UNBOUNDED, Layout


@dataclass(frozen=True)
class Programme:
    """The data of one tick, `A` (k, n) row by row, as `qp.build_qp` has them."""

    q: Array
    lower: Array
    upper: Array
    A: Array
    layout: Layout


@dataclass(frozen=True)
class Answer:
    """`x` (n,) and multipliers `y` (k,), positive at an upper bound; `has_answer`: whether the solver means them."""

    x: Array
    y: Array
    has_answer: bool
    status: str
    solver: str
    seconds: float


class Solver(Protocol):
    """Solves one programme a tick."""

    name: str

    def solve(self, programme: Programme) -> Answer: ...

    def reset(self) -> None:
        """Forget the last programme, so that an episode does not depend on the one before."""


class OsqpSolver:
    """OSQP, set up once for a layout and updated at every tick.

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
        self.reset()

    def reset(self) -> None:
        """The next programme sets the solver up again: no warm start."""
        self._layout: Layout | None = None

    def solve(self, programme: Programme) -> Answer:
        """Solve. OSQP cannot polish where no row is active, so a minimum without rows that meets them is taken."""
        start, p = time.perf_counter(), programme
        free = p.q * -0.5
        value = p.A @ free
        if (value >= p.lower).all() and (value <= p.upper).all():
            return Answer(free, np.zeros(len(p.upper)), True, "unconstrained", self.name, time.perf_counter() - start)
        if p.layout is self._layout:
            self._solver.update_data_vec(p.q, p.lower, p.upper)
            self._solver.update_data_mat(None, None, p.A[p.layout.rows, p.layout.columns], None)
        else:
            self._set_up(p)
        while self._status() == "interrupted":
            signal.raise_signal(signal.SIGINT)
        solution, status = self._solver.solution, self._solver.info.status
        seconds = time.perf_counter() - start
        return Answer(solution.x, solution.y, status == "solved", status, self.name, seconds)

    def _status(self) -> str:
        """Solve; return the solver's status."""
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            self._solver.solve()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        return str(self._solver.info.status)

    def _set_up(self, p: Programme) -> None:
        layout = p.layout
        A = sparse.csc_matrix((p.A[layout.rows, layout.columns], (layout.rows, layout.columns)), shape=layout.shape)
        problem = osqp.OSQP()
        problem.setup(sparse.eye(len(p.q), format="csc") * 2, p.q, A, p.lower, p.upper, **self.SETTINGS)
        self._solver = problem._solver  # the compiled one: its wrapper costs a tick as much as solving does
        self._layout = layout


class DaqpSolver:
    """DAQP, a dual active-set solver: exact, small and dense. It starts from no active set at every tick."""

    name = "daqp"

    def reset(self) -> None:
        """It keeps nothing."""

    def solve(self, programme: Programme) -> Answer:
        """Solve."""
        start, p = time.perf_counter(), programme
        sense = np.zeros(len(p.upper), dtype=np.int32)
        x, _, flag, info = daqp.solve(2 * np.eye(len(p.q)), p.q, p.A, p.upper, p.lower, sense)
        return Answer(x, info["lam"], flag > 0, f"exit {flag}", self.name, time.perf_counter() - start)


def daqp_in_casadi(layout: Layout, q: ca.MX, A: ca.MX, lower: ca.MX, upper: ca.MX) -> tuple[ca.MX, ca.MX]:
    """x (n,) and multipliers (k,) as expressions: DAQP inside a CasADi function. A is dense (k, n)."""
    rows, variables = layout.shape
    hessian = 2 * ca.DM.eye(variables)
    shapes = {"h": hessian.sparsity(), "a": ca.Sparsity.dense(rows, variables)}
    solve = ca.conic("daqp", "daqp", shapes, {"error_on_fail": False, "print_problem": False})
    answer = solve(h=hessian, g=q, a=A, lba=lower, uba=upper, lbx=-UNBOUNDED, ubx=UNBOUNDED)
    return answer["x"], answer["lam_a"]


def make_solver(name: str) -> OsqpSolver | DaqpSolver:
    """`osqp` or `daqp`."""
    return OsqpSolver() if name == "osqp" else DaqpSolver()
