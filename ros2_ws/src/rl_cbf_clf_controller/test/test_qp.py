"""The QP against closed forms, KKT residuals, and its two solvers against each other; no flag is trusted."""

import subprocess
import sys

import numpy as np
import pytest
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.objective import Objective
from cbf_clf_qp.qp import UNBOUNDED, Decision, build_qp
from cbf_clf_qp.rows import Rows
from cbf_clf_qp.saturation import Saturation
from cbf_clf_qp.solvers import DaqpSolver, GuardedSolver, OsqpSolver, Solution, kkt_residuals, make_solver
from rl_cbf_clf_controller.contact_force import force_rows, literal_cone_rows
from scipy import sparse

SOLVERS = [OsqpSolver, DaqpSolver]


def random_rows(rng, limit=200.0):
    """Rows as a tick has them: a soft CLF, rescued barriers and forces, hard saturation at `limit`, N m."""
    clf = Rows.at_most(("CLF",), rng.normal(0, 50, (1, 4)), rng.normal(-50, 100, 1), 5.0, rescue=False)
    barriers = Rows.at_least(("B1", "B2"), rng.normal(0, 0.5, (2, 4)), rng.normal(-20, 30, 2), 1e6)
    force = Affine(rng.normal(0, 1.5, (2, 4)), np.array([300.0, 50.0]) + rng.normal(0, 60, 2))
    forces = force_rows(force, 20.0, 0.8, 1e5)
    (saturation,) = Saturation(limit).rows(None, Affine(rng.normal(0, 1, (4, 4)), rng.normal(0, 30, 4)))
    return [clf.normalised(), barriers.normalised(), forces.normalised(), saturation]


@pytest.mark.parametrize("solver", SOLVERS)
def test_one_row_has_the_closed_form(solver):
    a, b = np.array([[3.0, 0, -4.0, 0]]), np.array([-10.0])
    qp = build_qp([Rows.at_most(("CLF",), a, b, np.inf)])
    assert solver().solve(qp).x == pytest.approx(a[0] * b[0] / 25, abs=1e-7)


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("p", [0.1, 5.0, 1e6])
def test_one_soft_row_has_the_closed_form(solver, p):
    a, b = np.array([3.0, 0, -4.0, 0]), -10.0
    qp = build_qp([Rows.at_most(("CLF",), a[None], np.array([b]), p, rescue=False)])
    decision = Decision(qp, solver().solve(qp).x)
    multiplier = -b / (25 + 1 / p)  # mu = -l a, s = l / p, a mu - s = b
    assert decision.mu == pytest.approx(-multiplier * a, rel=1e-5, abs=1e-7)
    assert decision.slack == pytest.approx([multiplier / p], rel=1e-5, abs=1e-6)
    assert decision.active == ("CLF",)


def test_nothing_is_printed_where_no_row_is_active(capfd):
    """OSQP says that it need not polish, whatever `verbose` is."""
    qp = build_qp([Rows.at_most(("CLF",), np.ones((1, 4)), np.array([100.0]), 5.0)])
    for _ in range(2):
        assert OsqpSolver().solve(qp).solved
    print("after")
    assert capfd.readouterr() == ("after\n", "")


INTERRUPTED = """
import os, signal, threading, time
import numpy as np
from cbf_clf_qp.qp import build_qp
from cbf_clf_qp.rows import Rows
from cbf_clf_qp.solvers import OsqpSolver

heard = []

def send():
    for count in range(1, 301):
        time.sleep(0.0003)
        os.kill(os.getpid(), signal.SIGINT)
        while len(heard) < count:
            time.sleep(0.0001)

signal.signal(signal.SIGINT, lambda *_: heard.append(1))
signal.pthread_sigmask(signal.SIG_BLOCK, [signal.SIGINT])  # also in the thread that begins now
sender = threading.Thread(target=send)
sender.start()
signal.pthread_sigmask(signal.SIG_UNBLOCK, [signal.SIGINT])
solver, rng = OsqpSolver(), np.random.default_rng(0)
while sender.is_alive():
    rows = Rows.at_least(("B1", "B2"), rng.normal(0, 0.5, (2, 4)), np.array([5.0, 5.0]), 1e6).normalised()
    assert solver.solve(build_qp([rows])).status == "solved"
print(len(heard))
"""


def test_an_interrupt_while_osqp_solves_is_not_lost():
    """OSQP has a handler of its own for SIGINT while it solves; that one would stop it and tell nobody."""
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=180, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "300\n", "")


def test_center_moves_the_free_minimum():
    center = np.array([1.0, 2.0, -3.0, 0.5])
    qp = build_qp([Rows.at_most(("CLF",), np.ones((1, 4)), np.array([100.0]), 5.0)], Objective(np.eye(4), center))
    assert Decision(qp, make_solver("osqp").solve(qp).x).mu == pytest.approx(center)


def test_solvers_agree_and_meet_kkt_on_random_ticks():
    rng = np.random.default_rng(2)
    osqp, daqp = OsqpSolver(), DaqpSolver()
    answered = 0
    for _ in range(300):
        qp = build_qp(random_rows(rng))
        exact, first = daqp.solve(qp), osqp.solve(qp)
        assert exact.solved
        assert exact.read[0].max() < 1e-6
        if first.solved:
            answered += 1
            assert first.x == pytest.approx(exact.x, abs=1e-3 * (1 + np.abs(exact.x).max()))
    assert answered >= 295


def clarabel_answer(qp):
    """x by an interior-point method; None where it finds none, as with slacks of a large cost."""
    clarabel = pytest.importorskip("clarabel")
    rows, bounds = np.vstack([qp.A, -qp.A]), np.concatenate([qp.upper, -qp.lower])
    is_bound = bounds < UNBOUNDED
    rows, bounds = sparse.csc_matrix(rows[is_bound]), bounds[is_bound]
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    cones = [clarabel.NonnegativeConeT(len(bounds))]
    twice = sparse.csc_matrix(2 * np.eye(qp.q.size))
    solution = clarabel.DefaultSolver(twice, qp.q, rows, bounds, cones, settings).solve()
    return np.array(solution.x) if str(solution.status) == "Solved" else None


@pytest.mark.parametrize("name", ["osqp", "daqp"])
def test_an_answer_keeps_to_the_hard_rows_and_is_the_optimum_whatever_the_limit(name):
    """The torque limit is 1e-3 to 1e3 N m, so that OSQP's tolerance on a row alone may be more than that."""
    rng, solver = np.random.default_rng(11), make_solver(name)
    compared = 0
    for _ in range(500):
        limit = 10 ** rng.uniform(-3, 3)
        qp = build_qp(random_rows(rng, limit))
        solution = solver.solve(qp)
        assert solution.solved
        is_hard, value, size = qp.layout.slack_scale == 0, qp.A @ solution.x, 1 + np.linalg.norm(solution.x)
        violation = np.maximum(qp.lower - value, value - qp.upper)
        let_pass = np.clip(1e-6 * (qp.upper - qp.lower), 1e-12 * size, None)
        assert (violation <= let_pass)[is_hard].all()
        reference = clarabel_answer(qp)
        if reference is not None:
            compared += 1
            assert solution.x == pytest.approx(reference, abs=1e-4 * size)
    assert compared > 400


def test_residuals_see_a_wrong_answer():
    qp = build_qp([Rows.at_most(("CLF",), np.ones((1, 4)), np.array([-8.0]), np.inf)])
    right, multiplier = np.full(4, -2.0), np.array([4.0]) * 2  # 2 x + A'y = 0 with A of norm one
    assert kkt_residuals(qp, right, multiplier).max() < 1e-12
    assert kkt_residuals(qp, right + 0.1, multiplier).min() > 1e-2
    assert kkt_residuals(qp, right - 0.1, multiplier)[1] == 0
    assert kkt_residuals(qp, right, multiplier * 2)[0] > 1e-2
    assert np.isnan(kkt_residuals(qp, np.full(4, np.nan), multiplier)).all()


@pytest.mark.parametrize("solver", SOLVERS)
def test_infeasible_hard_rows_are_not_solved(solver):
    rows = [
        Rows.at_most(("low",), np.eye(4)[:1], np.array([-1.0]), np.inf),
        Rows.at_least(("high",), np.eye(4)[:1], np.array([1.0]), np.inf),
    ]
    assert not solver().solve(build_qp(rows)).solved


@pytest.mark.parametrize("name", ["osqp", "daqp"])
def test_a_bound_out_of_reach_is_refused(name):
    """As in a state that has diverged."""
    solution = make_solver(name).solve(build_qp([Rows.at_most(("CLF",), np.ones((1, 4)), np.array([-1e42]), 10.0)]))
    assert (solution.solved, solution.status) == (False, "bad data")


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_bad_data_is_refused(value):
    qp = build_qp([Rows.at_most(("CLF",), np.array([[value, 0, 0, 0]]), np.array([-1.0]), 1.0)])
    assert not make_solver("osqp").solve(qp).solved


def test_guard_answers_and_is_counted():
    class Broken:
        name = "broken"

        def solve(self, qp, read):
            return Solution(np.full(qp.q.size, 2e9), False, "max iterations", self.name, 0.0)

        def reset(self):
            pass

    guarded = GuardedSolver(Broken(), DaqpSolver())
    solution = guarded.solve(build_qp([Rows.at_most(("CLF",), np.ones((1, 4)), np.array([-4.0]), np.inf)]))
    assert (solution.solver, guarded.unanswered) == ("daqp", 1)
    assert solution.x == pytest.approx(np.full(4, -1.0))


def test_slack_of_last_resort_keeps_saturation_feasible():
    rng = np.random.default_rng(3)
    impossible = Rows.at_least(("B1",), np.ones((1, 4)), np.array([1e6]), 1e6)
    control = Affine(np.eye(4), rng.normal(0, 10, 4))
    qp = build_qp([impossible, *Saturation(200.0).rows(None, control)])
    decision = Decision(qp, DaqpSolver().solve(qp).x)
    assert np.abs(control(decision.mu)).max() <= 200 + 1e-6
    assert decision.slack[0] > 0
    assert qp.layout.slack_kinds.tolist() == [[0.0] + 4 * [1.0], [1.0] + 4 * [0.0]]


@pytest.mark.parametrize(("force", "ok"), [((100, 79), True), ((100, -79), True), ((100, 81), False), ((10, 0), False)])
def test_force_rows_are_the_cone(force, ok):
    rows = force_rows(Affine(np.zeros((2, 4)), np.array(force, float)), 20.0, 0.8, 1e5)
    assert (rows.upper >= 0).all() == ok


def test_literal_cone_takes_the_present_sign():
    for tangential in (50.0, -90.0):
        rows = literal_cone_rows(Affine(np.zeros((2, 4)), np.array([100.0, tangential])), 20.0, 0.8, 1e5)
        assert rows.upper[1] == pytest.approx(80 - abs(tangential))
