"""The cone programme against the QP and closed forms."""

from collections.abc import Sequence

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.answer import Answering
from cbf_clf_qp.functions import Values
from cbf_clf_qp.qp import Layout, build_qp
from cbf_clf_qp.quantity import HARD, Rows, at_least, at_most
from rabbit_description.state import Array

pytest.importorskip("clarabel")
from rabbit_rivals.cone_programme import solve

NOTHING = np.zeros(1)


def of(values: Array | Sequence[float]) -> ca.SX:
    """Numbers as an expression."""
    return ca.SX(ca.DM(np.array(values)))


def programme(rows: list[Rows]) -> tuple[Values, Layout, Array]:
    """The data of a QP, and its mu."""
    layout, data = build_qp(rows, None, Affine(ca.SX.eye(4), ca.SX.zeros(4)))
    answering = Answering({"nothing": ca.SX.sym("nothing")}, data, layout, "daqp")
    return answering.programme(NOTHING), layout, answering(NOTHING).mu


def tick(rng: np.random.Generator) -> list[Rows]:
    clf = at_most(("CLF",), of(rng.normal(0, 50, (1, 4))), of(rng.normal(-50, 100, 1)), 5.0, rescue=False)
    barriers = at_least(("B1", "B2"), of(rng.normal(0, 0.5, (2, 4))), of(rng.normal(-20, 30, 2)), 1e6)
    torques = Rows(("u1", "u2"), of(rng.normal(size=(2, 4))), of([-200.0, -200.0]), of([200.0, 200.0]), HARD)
    return [clf, barriers, torques]


def test_without_margins_it_is_the_qp_and_margins_that_vanish_lead_to_it() -> None:
    rng = np.random.default_rng(3)
    for _ in range(20):
        qp, layout, exact = programme(tick(rng))
        x, is_solved, _ = solve(qp, layout, {})
        assert is_solved
        assert x[:4] == pytest.approx(exact, abs=1e-4 * (1 + np.abs(exact).max()))
        factor = rng.normal(size=(5, 5))
        found = [solve(qp, layout, {0: size * factor})[0][:4] for size in (1e-2, 1e-4, 1e-6)]
        assert np.abs(found[2] - exact).max() < 1e-4 * (1 + np.abs(exact).max())


def test_margins_have_their_closed_forms_and_what_no_input_meets_is_not_solved() -> None:
    """A constant margin is a tighter row; one in the direction of the input takes its share of it."""
    a, b, margin = np.array([[3.0, 0, -4.0, 0]]), -10.0, 2.0
    qp, layout, _ = programme([at_most(("CLF",), of(a), of([b]), HARD)])
    factor = np.array([[margin / 5, 0, 0, 0, 0]])  # the row's norm is 5
    assert solve(qp, layout, {0: factor})[0] == pytest.approx(a[0] * (b - margin) / 25, abs=1e-6)
    qp, layout, _ = programme([at_most(("CLF",), of([[1.0, 0, 0, 0]]), of([-1.0]), HARD)])
    factor = np.array([[0, 0.5, 0, 0, 0]])  # x + |x| / 2 <= -1
    assert solve(qp, layout, {0: factor})[0] == pytest.approx([-2.0, 0, 0, 0], abs=1e-6)
    assert not solve(qp, layout, {0: 4 * factor})[1]  # x + 2 |x| <= -1
