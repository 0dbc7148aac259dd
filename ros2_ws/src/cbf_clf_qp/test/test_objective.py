"""The objectives against numpy: a minimum without rows is known in closed form."""

from typing import Any

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.answer import Answering
from cbf_clf_qp.qp import build_qp, nearest
from cbf_clf_qp.quantity import at_most

M = 3


def minimum(objective: Any, symbols: dict[str, ca.SX], solver: str, bound: float = 1e6) -> Any:
    """mu as a function of the symbols' values; the one row, on mu's first component, does not matter if far."""
    row = at_most(("far",), ca.SX.eye(M)[:1, :], ca.SX(bound), 1e3)
    layout, data = build_qp([row], objective, Affine.identity(M))
    answering = Answering(symbols, data, layout, solver)
    return lambda *values: answering(*values).mu


@pytest.mark.parametrize("solver", ["daqp", "osqp"])
def test_nearest_gives_the_wanted_input(solver: str) -> None:
    """Whatever its weights, where no row is active."""
    a, b, wanted = ca.SX.sym("a", M, M), ca.SX.sym("b", M), ca.SX.sym("wanted", M)
    objective = nearest(Affine(a, b), wanted, ca.SX([1, 2, 3]))
    find, rng = minimum(objective, {"a": a, "b": b, "wanted": wanted}, solver), np.random.default_rng(0)
    for _ in range(20):
        matrix, offset, goal = rng.normal(size=(M, M)) + 3 * np.eye(M), rng.normal(size=M), rng.normal(size=M)
        assert matrix @ find(matrix, offset, goal) + offset == pytest.approx(goal, abs=1e-8)
