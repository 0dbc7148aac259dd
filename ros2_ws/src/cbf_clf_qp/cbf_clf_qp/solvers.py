"""Two QP solvers for  min x'x + q'x  subject to  lower <= A x <= upper;  multipliers y are positive at an upper bound.

DAQP, a dual active-set method, is exact and starts from nothing at every tick. OSQP starts from its last answer.
"""

import signal
from typing import ClassVar

import casadi as ca
import numpy as np

from cbf_clf_qp.functions import Array, Values
from cbf_clf_qp.qp import UNBOUNDED, Layout


def by_daqp(p: dict[str, ca.MX], layout: Layout) -> tuple[ca.MX, ca.MX]:
    """x (n,) and y (k,) as expressions of a programme's data: DAQP inside a CasADi function."""
    hessian = 2 * ca.DM.eye(layout.shape[1])
    shapes = {"h": hessian.sparsity(), "a": ca.Sparsity.dense(*layout.shape)}
    solve = ca.conic("daqp", "daqp", shapes, {"error_on_fail": False, "daqp": {"primal_tol": 1e-9}})
    answer = solve(h=hessian, g=p["q"], a=p["A"], lba=p["lower"], uba=p["upper"], lbx=-UNBOUNDED, ubx=UNBOUNDED)
    return answer["x"], answer["lam_a"]


class OsqpSolver:
    """OSQP, set up once for a layout and updated at every tick.

    While it solves, OSQP answers SIGINT itself: it stops, and nobody else hears of the signal. So a Ctrl-C waits until
    the programme is solved. If another thread took the signal, it is raised again and the programme is solved again.
    OSQP's own polishing prints to stdout where no row is active; `polished` does not.
    """

    STEPS: ClassVar = {"scaling": 0, "check_termination": 10, "max_iter": 4000, "adaptive_rho_interval": 50}
    SETTINGS: ClassVar = {"eps_abs": 1e-6, "eps_rel": 1e-6, "eps_prim_inf": 1e-8, "verbose": False, **STEPS}

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """The next programme sets the solver up again: no warm start."""
        self._layout: Layout | None = None

    def solve(self, p: Values, layout: Layout) -> tuple[Array, Array, str]:
        """x (n,), y (k,) and what OSQP says; it is not asked where the minimum without rows meets them all."""
        free = p.q * -0.5
        value = p.A @ free
        if (value >= p.lower).all() and (value <= p.upper).all():
            return free, np.zeros(len(p.upper)), "unconstrained"
        if layout is self._layout:
            self._solver.update_data_vec(p.q, p.lower, p.upper)
            self._solver.update_data_mat(None, None, p.A.T[self._entries], None)
        else:
            self._set_up(p, layout)
        while self._solved() == "interrupted":
            signal.raise_signal(signal.SIGINT)
        solution = self._solver.solution
        return (*polished(p, solution.x, solution.y), self._solver.info.status)

    def _solved(self) -> str:
        blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
        try:
            self._solver.solve()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        return str(self._solver.info.status)

    def _set_up(self, p: Values, layout: Layout) -> None:
        import osqp
        from scipy import sparse

        pattern = np.hstack([np.ones((len(layout.names), layout.inputs)), layout.of_slacks])
        self._entries = pattern.T.nonzero()  # of A, column by column, as OSQP has them
        columns, rows = self._entries
        A = sparse.csc_matrix((p.A[rows, columns], (rows, columns)), shape=layout.shape)
        problem = osqp.OSQP()
        problem.setup(sparse.eye(len(p.q), format="csc") * 2, p.q, A, p.lower, p.upper, **self.SETTINGS)
        self._solver = problem._solver  # the compiled one: its wrapper costs a tick as much as solving does
        self._layout = layout


def polished(p: Values, x: Array, y: Array) -> tuple[Array, Array]:
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
