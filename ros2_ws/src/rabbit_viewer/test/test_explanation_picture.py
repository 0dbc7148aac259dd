"""A tick of any system drawn: one input or three, with rows that exclude each other and without."""

from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp import Barrier, Clf, Rows, System, Terms, Tick, at_least
from matplotlib.image import imread
from rabbit_viewer.explanation_picture import draw_explanation
from rl_cbf_clf_controller.explanation import explain


def rows_over_three_inputs(terms: Terms) -> list[Rows]:
    """u_1 - u_3 is at least 4, where each is at most 1."""
    return [at_least(["a"], ca.DM([[1, 0, -1]]), ca.SX(4), 10.0)]


@pytest.mark.parametrize("speed", [0.1, 5.0])
def test_one_input(tmp_path: Path, speed: float) -> None:
    x, v, u = (ca.SX.sym(name) for name in ("x", "v", "u"))
    cart = System(ca.vertcat(x, v), u, ca.vertcat(v, u / 2))
    tick = Tick(cart, [Clf(x - 1, eps=0.2), Barrier("wall", 0.9 - x, (8, 8))], limit=100)
    told = explain(tick, np.array([0.8, speed]), tick.p())
    assert bool(told.excluding) == (speed == 5.0)
    assert told.inputs_that_matter() == [0]
    assert imread(draw_explanation(told, tmp_path / "tick.png")).shape[2] == 4


def test_three_inputs_and_the_two_that_matter(tmp_path: Path) -> None:
    x, u = ca.SX.sym("x"), ca.SX.sym("u", 3)
    tick = Tick(System(x, u, ca.sum1(u)), [], constraints=[rows_over_three_inputs], limit=1)
    told = explain(tick, np.zeros(1), tick.p())
    assert {*told.excluding} == {"a", "u1", "u3"}
    assert told.factor == pytest.approx(2, rel=1e-5)
    assert told.inputs_that_matter() == [0, 2]
    picture = draw_explanation(told, tmp_path / "tick.svg", names=("left", "middle", "right"), title="why")
    assert "svg" in picture.read_text()[:500]
