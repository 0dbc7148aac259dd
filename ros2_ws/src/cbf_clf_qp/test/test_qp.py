"""Seeded random programmes: KKT conditions in numpy, agreement of the solvers, who gives way first."""

import subprocess
import sys
from typing import Any

import casadi as ca
import daqp
import numpy as np
import pytest
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.answer import TOLERANCE, Answering
from cbf_clf_qp.qp import build_qp
from cbf_clf_qp.quantity import HARD, Rows, at_least, at_most

M, SOFT, LIMIT = 3, 5, 2.0  # inputs, soft rows; of |mu|


def programme(solver: str, root: bool) -> Answering:
    """Soft rows of two weights, hard limits; the bounds, rows and the objective are inputs."""
    A, upper, center, R = ca.SX.sym("A", SOFT, M), ca.SX.sym("upper", SOFT), ca.SX.sym("c", M), ca.SX.sym("R", M, M)
    blocks = [
        at_most(("a", "b"), A[:2, :], upper[:2], 10.0, rescue=False),
        at_least(("c", "d", "e"), -A[2:, :], -upper[2:], 100.0),
        Rows(("u1", "u2", "u3"), ca.SX.eye(M), -LIMIT * ca.SX.ones(M), LIMIT * ca.SX.ones(M)),
    ]
    layout, data = build_qp(blocks, Affine(R if root else ca.SX.eye(M), -center), Affine.identity(M))
    return Answering({"A": A, "upper": upper, "c": center, "R": R}, data, layout, solver)


def draw(rng: Any) -> tuple[Any, ...]:
    """Rows that are often in conflict, so that the programme has no solution without slack."""
    root = np.triu(rng.normal(size=(M, M)), 1) + np.diag(rng.uniform(1, 2, M))
    return rng.normal(size=(SOFT, M)), 3 * rng.normal(size=SOFT), rng.normal(size=M), root


def optimality(mu: Any, slack: Any, A: Any, upper: Any, center: Any, R: Any) -> float:
    """By how much the gradient of the cost is not in the cone of the active rows' normals: 0 at the minimum.

    Written over (mu, slack) without any scaling: |R mu - c|^2 + sum w s^2, A mu - |A_i| s_i <= upper, |mu| <= limit.
    """
    size, weight = np.linalg.norm(A, axis=1), np.array([10.0, 10, 100, 100, 100])
    of_slack = 2 * weight * slack  # each is the multiplier of its row, over |A_i|
    assert (A @ mu - size * slack <= upper + 1e-5).all()
    assert (of_slack[A @ mu - size * slack < upper - 1e-4] < 1e-3).all()
    assert np.abs(mu).max() <= LIMIT * (1 + 2 * TOLERANCE)
    gradient = 2 * R.T @ (R @ mu - center) + A.T @ (of_slack / size)
    gradient[(mu > LIMIT - 1e-6) & (gradient < 0)] = 0
    gradient[(mu < -LIMIT + 1e-6) & (gradient > 0)] = 0
    return float(np.abs(gradient).max())


@pytest.mark.parametrize("root", [False, True])
@pytest.mark.parametrize("solver", ["daqp", "osqp"])
def test_answers_meet_the_kkt_conditions(solver: str, root: bool) -> None:
    answering, rng, most = programme(solver, root), np.random.default_rng(5), 0
    for _ in range(200):
        A, upper, center, R = draw(rng)
        decided = answering(A, upper, center, R)
        assert decided.solved
        assert decided.values.residual[0] < 1e-6
        R = R if root else np.eye(M)
        slack = decided.values.slack[:SOFT]
        assert optimality(decided.mu, slack, A, upper, center, R) < 1e-3
        assert decided.values.slack_sums == pytest.approx([slack[:2].sum(), slack[2:].sum()])  # soft; last resort
        most += len(decided.slack)
    assert most > 200  # most programmes have no solution without slack
    assert answering.unanswered == 0


def test_the_solvers_agree() -> None:
    """DAQP in the function, DAQP's own interface, OSQP."""
    inside, osqp, rng = programme("daqp", True), programme("osqp", True), np.random.default_rng(6)
    for _ in range(200):
        data = draw(rng)
        first, second, p = inside(*data), osqp(*data), inside.programme(*data)
        assert (first.solver, second.solver) == ("daqp", "osqp")
        assert second.mu == pytest.approx(first.mu, abs=1e-6)
        assert second.values.slack == pytest.approx(first.values.slack, abs=1e-5)
        x, *_ = daqp.solve(2 * np.eye(M + SOFT), p.q, p.A, p.upper, p.lower, np.zeros(SOFT + M, dtype=np.int32))
        assert p.unroot @ x[:M] == pytest.approx(first.mu, abs=1e-6)


def test_an_answer_that_is_wrong_is_not_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    """A feasible point that is no minimum, with multipliers that make the gradient zero: DAQP is asked instead."""
    answering, data = programme("osqp", False), draw(np.random.default_rng(7))
    right = answering(*data)

    def wrong(p: Any) -> Any:
        x = p.q * 0
        x[M:] = 100.0  # slacks so large that every soft row holds
        return x, np.linalg.lstsq(p.A.T, -(2 * x + p.q), rcond=None)[0], TOLERANCE, "solved"

    monkeypatch.setattr(answering._osqp, "solve", wrong)
    assert answering._by_osqp(*data)[0].residual[0] > TOLERANCE
    guarded = answering(*data)
    assert (right.solver, guarded.solver, answering.unanswered) == ("osqp", "daqp", 1)
    assert guarded.mu == pytest.approx(right.mu, abs=1e-6)


@pytest.mark.parametrize("solver", ["daqp", "osqp"])
def test_beside_huge_slacks_an_answer_keeps_the_hard_rows_by_their_own_scale(solver: str) -> None:
    """Rows, bounds and weights over many decades: the slacks are up to 1e18 times as large as what the limit allows."""
    A, upper, weight = ca.SX.sym("A", SOFT, M), ca.SX.sym("upper", SOFT), ca.SX.sym("weight", SOFT)
    C, b, center = ca.SX.sym("C", M, M), ca.SX.sym("b", M), ca.SX.sym("center", M)
    side, least = ca.SX.sym("side", 1, M), ca.SX.sym("least")
    blocks = [at_most((f"soft{i}",), A[i, :], upper[i], weight[i]) for i in range(SOFT)]
    blocks += [at_least(("side",), side, least, HARD), Rows(("u1", "u2", "u3"), C, -LIMIT - b, LIMIT - b)]
    layout, data = build_qp(blocks, Affine(ca.SX.eye(M), -center), Affine(C, b))
    inputs = {"A": A, "upper": upper, "weight": weight, "C": C, "b": b, "center": center, "side": side, "least": least}
    answering, rng, largest = Answering(inputs, data, layout, solver), np.random.default_rng(11), []

    def scaled(low: float, high: float, *shape: int) -> Any:
        """Normal numbers, or rows of them, each of another decade."""
        return rng.normal(size=shape) * 10 ** rng.uniform(low, high, (*shape[:1], *[1] * (len(shape) - 1)))

    for _ in range(1000):
        soft = scaled(-6, 6, SOFT, M), scaled(-6, 12, SOFT), 10 ** rng.uniform(-6, 10, SOFT)
        control = rng.normal(size=(M, M)) * 10 ** rng.uniform(-3, 3), scaled(-3, 2, M)
        bound = -np.abs(scaled(-3, 3, 1))
        data = (*soft, *control, scaled(-3, 6, M), scaled(-3, 3, 1, M), bound)
        if (decided := answering(*data)).solved:
            assert np.abs(decided.u).max() <= LIMIT * (1 + 2 * TOLERANCE) + 1e-12 * np.abs(control[1]).max()
            size = np.linalg.norm(data[-2])
            assert data[-2] @ decided.mu - bound >= -TOLERANCE * (size + np.abs(bound)) * (1 + 1e-6)
            largest.append(np.abs(decided.values.x).max())
    assert len(largest) > 400
    assert np.quantile(largest, 0.75) > 1e6


@pytest.mark.parametrize("solver", ["daqp", "osqp"])
def test_rows_give_way_in_order_of_their_weights(solver: str) -> None:
    """CLF before barrier, barrier before the limit of the input, which never does."""
    one = ca.SX.ones(1, 1)
    goal, floor = ca.SX.sym("goal"), ca.SX.sym("floor")
    rows = [
        at_least(("CLF",), one, goal, 10.0, rescue=False),
        at_most(("B",), one, floor, 1e6),
        Rows(("u1",), one, ca.SX(-1), ca.SX(1)),
    ]
    layout, data = build_qp(rows, None, Affine.identity(1))
    answering = Answering({"goal": goal, "floor": floor}, data, layout, solver)
    cases = {(0.5, 0.8): (0.5 / 1.1, 0.0), (0.5, 0.2): (0.2, 0.0), (5.0, -3.0): (-1.0, 2.0), (3.0, 9.0): (1.0, 0.0)}
    for (low, high), (u, over) in cases.items():  # at most `high`, but for `over`
        decided = answering(np.array([low]), np.array([high]))
        assert decided.solved
        assert decided.u[0] == pytest.approx(u, abs=1e-4)
        assert abs(decided.u[0]) <= 1 + 1e-9
        assert [decided.slack.get(name, 0.0) for name in ("CLF", "B")] == pytest.approx([low - u, over], abs=1e-4)


@pytest.mark.parametrize("solver", ["daqp", "osqp"])
def test_what_has_no_solution_is_not_solved(solver: str) -> None:
    """Hard rows in conflict."""
    low = ca.SX.sym("low")
    one = ca.SX.ones(1, 1)
    rows = [at_least(("low",), one, low, HARD), at_most(("high",), one, ca.SX(1), HARD)]
    layout, data = build_qp(rows, None, Affine.identity(1))
    answering = Answering({"low": low}, data, layout, solver)
    assert answering(np.array([0.5])).u == pytest.approx([0.5])
    assert not answering(np.array([2.0])).solved
    assert not answering(np.array([np.inf])).solved
    assert not answering(np.array([np.nan])).solved
    assert answering(np.array([0.7])).u == pytest.approx([0.7])


INTERRUPTED = """
import os, signal, threading, time
import casadi as ca
import numpy as np
from cbf_clf_qp import Affine
from cbf_clf_qp.answer import Answering
from cbf_clf_qp.qp import build_qp
from cbf_clf_qp.quantity import at_least

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
A = ca.SX.sym("A", 2, 4)
layout, data = build_qp([at_least(("B1", "B2"), A, ca.SX([5, 5]), 1e6)], None, Affine.identity(4))
answering, rng = Answering({"A": A}, data, layout, "osqp"), np.random.default_rng(0)
while sender.is_alive():
    assert answering(rng.normal(0, 0.5, (2, 4))).status == "solved"
print(len(heard))
"""


def test_an_interrupt_while_osqp_solves_is_not_lost() -> None:
    """OSQP has a handler of its own for SIGINT while it solves; that one would stop it and tell nobody."""
    done = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=180, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (0, "300\n", "")
