"""What a recipe's parts say at a tick counts at that tick, also where they have changed since the last one.

The cart of the README: pulled to 1 m, with a wall in front of it.
"""

import contextlib
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.clf import Clf
from cbf_clf_qp.ecbf import Barriers, Ecbf
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.io_linearization import precontrol
from cbf_clf_qp.objective import Objective
from cbf_clf_qp.res_clf import ResClf
from cbf_clf_qp.rows import Rows
from cbf_clf_qp.saturation import Saturation
from cbf_clf_qp.solvers import make_solver
from cbf_clf_qp.tick import Decided, Estimator, Recipe, Terms, decide

MASS, GOAL = 2.0, 1.0  # kg, m


@dataclass
class Dynamics:
    acceleration: Affine


@dataclass
class Outputs:
    eta: np.ndarray

    def second_derivative(self, acceleration: Affine) -> Affine:
        return acceleration


@dataclass
class Scene:
    x: np.ndarray
    v: np.ndarray
    outputs: Outputs


class Wall(Ecbf):
    """Where it is may change."""

    names = ("wall",)

    def __init__(self, at: float) -> None:
        super().__init__((8.0, 8.0), rescue_weight=1e6)
        self.at = at

    def barriers(self, scene: Scene) -> Barriers:
        return Barriers(B=self.at - scene.x, dB=-scene.v, jacobian=-np.eye(1), bias=np.zeros(1))


class Limit:
    """On the force, N, as a constraint of one's own."""

    def __init__(self, most: float) -> None:
        self.most = most

    def rows(self, terms: Any, control: Affine) -> list[Rows]:
        return [Rows.between(("u1",), control.a, -self.most - control.b, self.most - control.b)]


class Constant(Estimator[Scene]):
    """The same arrays at every tick."""

    def __init__(self, alpha: np.ndarray, beta: np.ndarray) -> None:
        self.estimates = Estimates(alpha, beta)

    def estimate(self, terms: Terms[Scene], before: Estimates) -> Estimates:
        return self.estimates


def cart(*parts: Any, constraint: Any = None, clf: ResClf | None = None) -> Recipe[Scene]:
    """`parts`: a wall, if any, then estimators."""
    walls = tuple(part for part in parts if isinstance(part, Ecbf))
    quantities = (Clf(clf or ResClf(outputs=1, eps=0.2, gains=(1.0, 2.0)), slack_weight=10.0), *walls)
    return Recipe(quantities, (constraint or Saturation(100.0),), tuple(part for part in parts if part not in walls))


def tick(recipe: Recipe[Scene], acceleration: Any = None) -> Decided:
    """At 0.3 m and 0.5 m/s."""
    x, v = np.array([0.3]), np.array([0.5])
    scene = Scene(x, v, Outputs(np.concatenate([x - GOAL, v])))
    dynamics = Dynamics(acceleration or Affine(np.eye(1) / MASS, np.zeros(1)))
    terms = Terms.of(recipe.quantities, scene, dynamics, precontrol(dynamics.acceleration))
    return decide(recipe, terms, make_solver("daqp"))


def force(recipe: Recipe[Scene]) -> float:
    return float(tick(recipe).u[0])


def test_a_wall_that_moves():
    wall = Wall(0.9)
    recipe = cart(wall)
    before = force(recipe)
    wall.at = 0.4
    assert force(recipe) == pytest.approx(force(cart(Wall(0.4))))
    wall.at = 0.9
    assert force(recipe) == before > force(cart(Wall(0.4))) + 1


def test_a_constraint_that_changes():
    limit = Limit(100.0)
    recipe = cart(constraint=limit)
    assert force(recipe) > 1
    limit.most = 1.0
    assert force(recipe) == pytest.approx(1.0)


def test_an_objective_that_changes():
    center = np.array([5.0])
    clf = cart().quantities
    recipe = Recipe(clf, (Saturation(100.0),), objective=lambda terms, estimates: Objective(np.eye(1), center.copy()))
    before = force(recipe)
    center[:] = -50.0
    assert force(recipe) < before - 1


@dataclass
class Weighted:
    """Of a policy: numbers of which the tick makes estimates."""

    values: np.ndarray

    def at(self, terms: Any) -> Estimates:
        return Estimates(np.zeros((1, 1)), 2 * self.values)


@dataclass
class Shifted:
    """The same numbers of another policy."""

    values: np.ndarray

    def at(self, terms: Any) -> Estimates:
        return Estimates(np.zeros((1, 1)), self.values + 7)


class Pends(Estimator[Scene]):
    """A policy that leaves its estimates to the tick."""

    def __init__(self, kind: type) -> None:
        self.kind = kind

    def estimate(self, terms: Terms[Scene], before: Estimates) -> Estimates:
        raise AssertionError("expected pending")

    def pending(self, terms: Any, before: Any) -> Any:
        return self.kind(np.ones(1))


def test_a_policy_that_is_swapped_for_one_with_the_same_fields():
    recipe = cart(Pends(Weighted))
    of_first, other = tick(recipe), Recipe(recipe.quantities, recipe.constraints, (Pends(Shifted),))
    assert of_first.estimates.beta.tolist() == [2.0]
    assert tick(other).estimates.beta.tolist() == [8.0]
    other.__dict__["programme"] = recipe.programme  # as of a controller whose policy is swapped
    assert tick(other).estimates.beta.tolist() == [8.0]


def test_estimates_in_read_only_views_of_arrays_that_change():
    base = np.zeros(3)
    alpha, beta = base[:1].reshape(1, 1).view(), base[1:2].view()
    for view in (alpha, beta):
        view.flags.writeable = False
    recipe = cart(Constant(alpha, beta))
    before = force(recipe)
    base[:] = 0.1, 20.0, 0.0
    assert force(recipe) == pytest.approx(force(cart(Constant(np.array([[0.1]]), np.array([20.0])))))
    assert abs(force(recipe) - before) > 0.1


def test_an_estimator_that_writes_into_no_estimates_changes_no_other_controller():
    class Writes(Estimator[Scene]):
        def estimate(self, terms: Terms[Scene], before: Estimates) -> Estimates:
            before.beta[:] += 1000.0
            return before

    before = force(cart())
    with contextlib.suppress(ValueError):  # the arrays may be read-only
        tick(cart(Writes()))
    assert force(cart()) == before
    assert not Estimates.zero(1, 1).beta.any()


@pytest.mark.parametrize("of_term", ["a", "b"])
def test_a_state_that_is_no_number_is_bad_data_at_every_tick(of_term):
    recipe = cart(Wall(0.9))
    for _ in range(2):
        assert tick(recipe).solution.solved
        wrong = Affine(np.eye(1) / MASS, np.zeros(1))
        getattr(wrong, of_term)[:] = np.nan
        solution = tick(recipe, wrong).solution
        assert (solution.solved, solution.status) == (False, "bad data")
