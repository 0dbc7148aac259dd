"""QP solvers behind one small interface, for  min x'x + q'x  subject to  lower <= A x <= upper.

What a solver says of its own answer does not count: `answer.py` asks for the KKT residual.
"""

import signal
from typing import Any, ClassVar, Protocol

import casadi as ca
import daqp
import numpy as np
import osqp
from scipy import sparse

from cbf_clf_qp.symbolic.functions import Array
from cbf_clf_qp.symbolic.qp import UNBOUNDED, Layout

Answer = tuple[Array, Array, str]  # x (n,), multipliers (k,), positive at an upper bound, and what the solver says


class Solver(Protocol):
    """Solves one programme a tick."""

    name: str

    def solve(self, p: Any, layout: Layout) -> Answer:
        """Of a programme `p` with q (n,), lower, upper (k,) and A (k, n), as `qp.build_qp` has them."""

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
        "polishing": False,  # it prints where no row is active; see `polished`
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

    def solve(self, p: Any, layout: Layout) -> Answer:
        """Solve, unless the minimum without rows meets them all."""
        free = p.q * -0.5
        value = p.A @ free
        if (value >= p.lower).all() and (value <= p.upper).all():
            return free, np.zeros(len(p.upper)), "unconstrained"
        if layout is self._layout:
            self._solver.update_data_vec(p.q, p.lower, p.upper)
            self._solver.update_data_mat(None, None, p.A[layout.rows, layout.columns], None)
        else:
            self._set_up(p, layout)
        while self._status() == "interrupted":
            signal.raise_signal(signal.SIGINT)
        solution = self._solver.solution
        return (*polished(p, solution.x, solution.y), self._solver.info.status)

    def _status(self) -> str:
        """Solve; return the solver's status."""
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            self._solver.solve()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        return str(self._solver.info.status)

    def _set_up(self, p: Any, layout: Layout) -> None:
        A = sparse.csc_matrix((p.A[layout.rows, layout.columns], (layout.rows, layout.columns)), shape=layout.shape)
        problem = osqp.OSQP()
        problem.setup(sparse.eye(len(p.q), format="csc") * 2, p.q, A, p.lower, p.upper, **self.SETTINGS)
        self._solver = problem._solver  # the compiled one: its wrapper costs a tick as much as solving does
        self._layout = layout


def polished(p: Any, x: Array, y: Array) -> tuple[Array, Array]:
    """The exact solution if those rows are active that seem to be, A_a x = b:  A_a A_a' y_a = -(2 b + A_a q)."""
    value = p.A @ x
    at_upper = p.upper - value < y
    active = at_upper | (value - p.lower < -y)
    A, b = p.A[active], np.where(at_upper, p.upper, p.lower)[active]
    exact = np.zeros_like(y)
    try:
        exact[active] = np.linalg.solve(A @ A.T, -(2 * b + A @ p.q))
    except np.linalg.LinAlgError:
        return x, y
    return -0.5 * (p.q + exact @ p.A), exact


class DaqpSolver:
    """DAQP, a dual active-set solver: exact, small and dense. It starts from no active set at every tick."""

    name = "daqp"

    def reset(self) -> None:
        """It keeps nothing."""

    def solve(self, p: Any, layout: Layout) -> Answer:
        """Solve."""
        sense = np.zeros(len(p.upper), dtype=np.int32)
        x, _, flag, info = daqp.solve(2 * np.eye(len(p.q)), p.q, p.A, p.upper, p.lower, sense)
        return x, info["lam"], f"exit {flag}"


def daqp_in_casadi(layout: Layout, q: ca.MX, A: ca.MX, lower: ca.MX, upper: ca.MX) -> tuple[ca.MX, ca.MX]:
    """x (n,) and multipliers (k,) as expressions: DAQP inside a CasADi function. A is dense (k, n)."""
    rows, variables = layout.shape
    hessian = 2 * ca.DM.eye(variables)
    shapes = {"h": hessian.sparsity(), "a": ca.Sparsity.dense(rows, variables)}
    solve = ca.conic("daqp", "daqp", shapes, {"error_on_fail": False, "print_problem": False})
    answer = solve(h=hessian, g=q, a=A, lba=lower, uba=upper, lbx=-UNBOUNDED, ubx=UNBOUNDED)
    return answer["x"], answer["lam_a"]


def make_solver(name: str) -> Solver:
    """`osqp` or `daqp`; raises ValueError for another name."""
    if name not in ("osqp", "daqp"):
        raise ValueError(f"solver = {name}: expected osqp or daqp")
    return OsqpSolver() if name == "osqp" else DaqpSolver()
