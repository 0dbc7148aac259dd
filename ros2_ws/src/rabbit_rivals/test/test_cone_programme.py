"""The cone programme against the QP and closed forms."""

import numpy as np
import pytest
from cbf_clf_qp.qp import Decision, build_qp
from cbf_clf_qp.rows import Rows
from cbf_clf_qp.solvers import DaqpSolver

pytest.importorskip("clarabel")
from rabbit_rivals.cone_programme import solve


def tick(rng: np.random.Generator) -> list[Rows]:
    clf = Rows.at_most(("CLF",), rng.normal(0, 50, (1, 4)), rng.normal(-50, 100, 1), 5.0, rescue=False)
    barriers = Rows.at_least(("B1", "B2"), rng.normal(0, 0.5, (2, 4)), rng.normal(-20, 30, 2), 1e6)
    torques = Rows.between(("u1", "u2"), rng.normal(size=(2, 4)), np.full(2, -200.0), np.full(2, 200.0))
    return [clf.normalised(), barriers.normalised(), torques]


def test_without_margins_it_is_the_qp_and_margins_that_vanish_lead_to_it() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        qp = build_qp(tick(rng))
        exact = DaqpSolver().solve(qp).x
        solution = solve(qp, {})
        assert solution.solved
        assert solution.x == pytest.approx(exact, abs=1e-4 * (1 + np.abs(exact).max()))
        factor = rng.normal(size=(5, 5))
        distance = [np.abs(solve(qp, {0: size * factor}).x - exact).max() for size in (1e-2, 1e-4, 1e-6)]
        assert distance[2] < 1e-4 * (1 + np.abs(exact).max())


def test_a_constant_margin_is_a_tighter_row() -> None:
    a, b, margin = np.array([[3.0, 0, -4.0, 0]]), -10.0, 2.0
    qp = build_qp([Rows.at_most(("CLF",), a, np.array([b]), np.inf)])
    factor = np.array([[margin / 5, 0, 0, 0, 0]])  # the row's norm is 5
    assert solve(qp, {0: factor}).x == pytest.approx(a[0] * (b - margin) / 25, abs=1e-6)


def test_a_margin_in_the_direction_of_the_input_has_the_closed_form() -> None:
    qp = build_qp([Rows.at_most(("CLF",), np.array([[1.0, 0, 0, 0]]), np.array([-1.0]), np.inf)])
    factor = np.array([[0, 0.5, 0, 0, 0]])  # x + |x| / 2 <= -1
    assert solve(qp, {0: factor}).x == pytest.approx([-2.0, 0, 0, 0], abs=1e-6)


def test_every_row_holds_with_its_margin() -> None:
    rng = np.random.default_rng(5)
    for _ in range(10):
        qp = build_qp(tick(rng))
        factors = {i: rng.normal(0, 0.05, (5, 5)) for i in range(3)}
        solution = solve(qp, factors)
        mu = Decision(qp, solution.x).mu
        for i, factor in factors.items():
            assert qp.A[i] @ solution.x + np.linalg.norm(factor @ [1, *mu]) <= qp.upper[i] + 1e-5


def test_what_no_input_meets_is_not_solved() -> None:
    qp = build_qp([Rows.at_most(("CLF",), np.array([[1.0, 0, 0, 0]]), np.array([-1.0]), np.inf)])
    assert not solve(qp, {0: np.array([[0, 2.0, 0, 0, 0]])}).solved  # x + 2 |x| <= -1


def test_a_slack_of_last_resort_may_be_large() -> None:
    row = Rows.at_most(("CLF",), np.array([[1.0, 0, 0, 0]]), np.array([-300.0]), 1e6)
    torques = Rows.between(("u1",), np.array([[1.0, 0, 0, 0]]), np.array([-100.0]), np.array([100.0]))
    decision = Decision(qp := build_qp([row, torques]), solve(qp, {0: np.array([[1.0, 0, 0, 0, 0]])}).x)
    assert decision.mu == pytest.approx([-100, 0, 0, 0], abs=1e-2)
    norm = np.linalg.norm(qp.A[0] / qp.A[0, 0])
    assert decision.slack[0] == pytest.approx(300 - 100 + norm, rel=1e-6)
