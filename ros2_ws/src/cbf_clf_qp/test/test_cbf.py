"""A barrier of relative degree 1: a car's speed, whose answer is known in closed form."""

from types import SimpleNamespace

import numpy as np
import pytest
from cbf_clf_qp.affine import Affine, Array
from cbf_clf_qp.cbf import Cbf
from cbf_clf_qp.solvers import make_solver
from cbf_clf_qp.tick import Recipe, Terms, decide

LIMIT, RATE, SECONDS = 20.0, 2.0, 0.01


class SpeedLimits(Cbf):
    """Two of them, on v and on 2 v; the scene is v."""

    names = ("slow", "slower")

    def value(self, scene: float) -> Array:
        return np.array([LIMIT - scene, LIMIT - 2 * scene])

    def derivative(self, scene: float, acceleration: Affine) -> Affine:
        return acceleration.mapped(np.array([[-1.0], [-2.0]]))


BARRIERS = SpeedLimits(RATE, 1e8)
FREE = SimpleNamespace(acceleration=Affine.identity(1))


@pytest.mark.parametrize("v", [9.0, 10.0, 12.0])
def test_the_tighter_row_decides(v: float) -> None:
    """-2 mu + RATE (LIMIT - 2 v) >= 0 at least; no input where that holds at mu = 0."""
    recipe = Recipe[float]((BARRIERS,))
    terms = Terms.of(recipe.quantities, v, FREE, Affine.identity(1))
    decided = decide(recipe, terms, make_solver("daqp"))
    assert decided.mu[0] == pytest.approx(min(0.0, RATE * (LIMIT - 2 * v) / 2), abs=1e-5)


def test_a_measured_rate_is_the_predicted_one() -> None:
    """Exact, as B is linear in v."""
    mu = np.array([3.0])
    predicted = BARRIERS.predict(10.0, FREE)(mu)
    assert BARRIERS.measure(10.0, 10.0 + SECONDS * mu[0], SECONDS) == pytest.approx(predicted)


@pytest.mark.parametrize("rate", [0.0, -1.0, float("nan")])
def test_a_rate_is_positive(rate: float) -> None:
    with pytest.raises(ValueError, match="rate = "):
        SpeedLimits(rate, 1.0)
