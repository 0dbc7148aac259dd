"""Explained ticks: a cart between walls in closed form; random rows against certificates of another algorithm."""

from typing import Any

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp import Barrier, Clf, Estimates, Rows, System, Terms, Tick, at_most
from rl_cbf_clf_controller.explanation import Explanation, explain
from scipy.optimize import nnls

MASS, LIMIT, POLE = 2.0, 100.0, 8.0
M, ROWS = 3, 6


def cart(limit: float | None = LIMIT, **options: Any) -> Tick:
    """Pulled to x = 1 m between two walls."""
    x, v, u, left, right = (ca.SX.sym(name) for name in ("x", "v", "u", "left", "right"))
    system = System(ca.vertcat(x, v), u, ca.vertcat(v, u / MASS), [left, right])
    walls = [Barrier(name, B, (POLE, POLE)) for name, B in (("left", x - left), ("right", right - x))]
    return Tick(system, [Clf(x - 1, eps=0.2), *walls], limit=limit, **options)


def explained(tick: Tick, x: float, v: float, left: float = -9.0, right: float = 0.9, **estimates: Any) -> Explanation:
    """At a state, between these walls."""
    error = Estimates(**estimates) if estimates else None
    return explain(tick, np.array([x, v]), tick.p(left=left, right=right), error)


def asked(B: float, rate: float) -> float:
    """B'' of a barrier, at least."""
    return -(POLE**2) * B - 2 * POLE * rate


def test_a_wall_that_is_too_near_excludes_the_limit() -> None:
    told = explained(cart(), x=0.8, v=5.0)
    least = asked(0.1, -5.0)  # 73.6 m/s^2
    assert told.excluding == {"right": "at least 73.6", "u1": "at least -100"}
    assert told.factor == pytest.approx(least * MASS / LIMIT, rel=1e-5)
    rows = {row.name: row for row in told.rows}
    wall = rows["right"]
    assert wall.lower == pytest.approx(least)
    assert wall.upper == np.inf
    assert wall.value == pytest.approx(-told.w[0] / MASS)
    assert wall.gives_way == pytest.approx(least - LIMIT / MASS, rel=1e-4)
    assert (wall.kind, rows["CLF"].kind, rows["u1"].kind) == ("last resort", "soft", "hard")
    assert rows["u1"].value == told.w[0] == pytest.approx(-LIMIT)
    assert rows["right"].state == "gives way"
    assert rows["left"].state == ""
    assert "  right: at least 73.6" in told.lines()
    assert "  right, keep off: at least 73.6 m/s²" in told.lines({"right": ("keep off", "m/s²")})


@pytest.mark.parametrize("limit", [LIMIT, None])
def test_walls_that_have_changed_places_exclude_each_other_whatever_the_force(limit: float | None) -> None:
    told = explained(cart(limit), x=0.95, v=0.3, left=1.0, right=0.9)
    assert set(told.excluding) == {"left", "right"}
    assert told.factor == (None if limit is None else np.inf)
    assert any("No input would do" in line for line in told.lines()) == (limit is not None)


def test_where_nothing_excludes_the_soft_row_pays() -> None:
    told = explained(cart(), x=0.85, v=0.1)
    assert told.excluding == {}
    least = max(asked(0.05, -0.1), 0) * MASS / LIMIT  # the wall asks for less than the cart is pulled by
    assert told.factor == pytest.approx(least, abs=1e-5)
    (paying,) = (row for row in told.rows if row.gives_way > 1e-3)
    assert paying.name == "CLF"
    assert any(line.startswith("CLF gives way by") and "soft" in line for line in told.lines())


def test_a_row_is_the_model_and_the_share_of_the_estimates() -> None:
    alpha, beta = np.array([[0.0], [0.3], [0.5]]), np.array([0.0, 1.0, -4.0])
    told = explained(cart(), x=0.8, v=1.0, alpha=alpha, beta=beta)
    mu, rows = told.w[0] / MASS, {row.name: row for row in told.rows}
    assert rows["right"].nominal == pytest.approx(-mu)
    assert rows["right"].estimated == pytest.approx(0.5 * mu - 4)
    assert rows["left"].nominal == pytest.approx(mu)
    assert rows["left"].estimated == pytest.approx(0.3 * mu + 1)
    assert rows["u1"].estimated == pytest.approx(0.0)


def rows_of_random() -> Tick:
    """Rows of last resort that are parameters, over u in R^3 with a limit."""
    A, upper, x, u = ca.SX.sym("A", ROWS, M), ca.SX.sym("upper", ROWS), ca.SX.sym("x"), ca.SX.sym("u", M)
    system = System(x, u, ca.sum1(u), {"A": A, "upper": upper})

    def rows(terms: Terms) -> list[Rows]:
        return [at_most([f"r{i}" for i in range(ROWS)], A, upper, 10.0)]

    return Tick(system, [], constraints=[rows], limit=1.0)


def excludes(A: Any, b: Any) -> bool:
    """Whether A u <= b has no solution: y >= 0 with A'y = 0 and b'y = -1 (Farkas), by Lawson and Hanson's algorithm."""
    return len(b) > 0 and bool(nnls(np.vstack([A.T, b]), np.append(np.zeros(A.shape[1]), -1.0))[1] < 1e-8)


def test_random_rows_have_a_certificate_and_every_proper_subset_a_solution() -> None:
    tick, rng, found = rows_of_random(), np.random.default_rng(3), set()
    for _ in range(60):
        A, upper = rng.normal(size=(ROWS, M)) * rng.integers(2, size=(ROWS, M)), rng.normal(size=ROWS) - 0.3
        told = explain(tick, np.zeros(1), tick.p(A=A, upper=upper))
        every_A, every_b = np.vstack([A, np.eye(M), -np.eye(M)]), np.concatenate([upper, np.ones(2 * M)])
        names = [f"r{i}" for i in range(ROWS)] + [f"u{i + 1}" for i in range(M)] * 2
        sides = ["at most"] * (ROWS + M) + ["at least"] * M
        assert bool(told.excluding) == excludes(every_A, every_b)
        chosen = [i for i, name in enumerate(names) if told.excluding.get(name, "").startswith(sides[i])]
        assert len(chosen) == len(told.excluding) <= M + 1
        if chosen:
            assert excludes(every_A[chosen], every_b[chosen])
            assert not any(excludes(every_A[rest], every_b[rest]) for rest in (np.setdiff1d(chosen, i) for i in chosen))
        assert told.factor is not None
        for factor in (0.99 * told.factor, 1.01 * told.factor) if 0 < told.factor < np.inf else ():
            limited = np.concatenate([upper, factor * np.ones(2 * M)])
            assert excludes(every_A, limited) == (factor < told.factor)
        found.add((len(chosen), told.factor < np.inf))
    assert {(0, True), (1, False), (2, True), (3, True), (4, True), (2, False)} <= found
