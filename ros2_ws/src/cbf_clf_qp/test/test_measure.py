"""Measured values against the exact derivative, and the error of one model against another."""

from typing import Any

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.constraints import Barrier, Clf
from cbf_clf_qp.estimates import measure, model_error
from cbf_clf_qp.quantity import Quantity, Terms
from cbf_clf_qp.system import System

SECONDS = 0.01


@pytest.mark.parametrize("seed", range(5))
def test_constant_acceleration_is_measured_exactly(make_plant: Any, seed: int) -> None:
    """Of a cart under a held force, whatever mass its model has: relative degrees 1 and 2, a wall that moves."""
    plant = make_plant("cart")
    s, rng = plant.symbols, np.random.default_rng(seed)
    quantities = [Clf(s["x"] - 1), Barrier("wall", s["wall"] - s["x"], (2, 3)), Barrier("slow", 3 - s["v"], (1,))]
    terms = Terms(plant.system, quantities)
    x, v, acceleration, wall, speed = rng.normal(size=5)
    before, after = ((x + v * t + acceleration * t**2 / 2, v + acceleration * t) for t in (0, SECONDS))
    parameters = [np.array([rng.uniform(1, 9), wall + speed * t, speed]) for t in (0, SECONDS)]
    ends = np.array(before), parameters[0], np.array(after), parameters[1]
    measured = measure(terms)(*ends, np.array([SECONDS])).measured
    V_dot = terms.quantities[0].slope
    assert V_dot
    exact = plant.number(V_dot(acceleration), before, 0.0)
    assert measured == pytest.approx([exact, -acceleration, -acceleration], rel=1e-9)


def test_a_measured_value_is_the_mean_of_the_exact_ones(make_plant: Any) -> None:
    """Of a Segway, in a tick of 1 ms: it differs from the mean of both ends by the square of the tick."""
    plant, rng = make_plant("segway"), np.random.default_rng(1)
    v, theta, omega = (plant.symbols[name] for name in ("v", "theta", "omega"))
    quantities = [Barrier("fast", 3 - v - 1.2 * ca.cos(theta) * omega, (4,)), Barrier("lean", 1 - theta**2, (4, 4))]
    terms = Terms(plant.system, quantities)
    p, step, ticks = np.array([plant.values["body"]]), 1e-5, 100
    for _ in range(5):
        before, u = rng.normal(size=3), 50 * rng.normal()
        after = before
        for _ in range(ticks):  # midpoint rule
            half = after + step / 2 * plant.number(plant.system.x_dot, after, u)
            after = after + step * plant.number(plant.system.x_dot, half, u)
        measured = measure(terms)(before, p, after, p, np.array([step * ticks])).measured
        values = [quantity.value(plant.system.u) for quantity in terms.quantities]
        exact = [np.mean([plant.number(value, x, u) for x in (before, after)]) for value in values]
        assert measured == pytest.approx(exact, rel=1e-4, abs=1e-4)


@pytest.fixture
def chain() -> System:
    """x''' = u."""
    x, u = ca.SX.sym("x", 3), ca.SX.sym("u")
    return System(x, u, ca.vertcat(x[1], x[2], u))


def test_relative_degree_3_is_not_measured(chain: System) -> None:
    """Remark 3; but it has rows, see `test_system.py`."""
    for each in (Barrier("deep", chain.x[0], (1, 2, 3)), Clf(chain.x[0], gains=(1.0, 3.0, 3.0))):
        with pytest.raises(ValueError, match=r"(deep|V): one difference measures relative degrees 1 and 2 only"):
            measure(Terms(chain, [each]))


def test_a_sensor_is_read_as_the_tick_ends(chain: System) -> None:
    force = Quantity(("F",), chain.affine(chain.u), lambda _: [], sensor=2 * chain.x[2])
    terms = Terms(chain, [force])
    nothing = np.zeros(0)
    measured = measure(terms)(np.zeros(3), nothing, np.array([0.0, 0.0, 4.0]), nothing, np.array([SECONDS])).measured
    assert measured == pytest.approx([8])


def test_the_error_of_the_same_model_is_zero(make_plant: Any) -> None:
    plant, rng = make_plant("segway"), np.random.default_rng(2)
    v, theta = plant.symbols["v"], plant.symbols["theta"]
    terms = Terms(plant.system, [Clf(theta), Barrier("slow", 3 - v, (4,))])
    error, p = model_error(terms), np.array([60.0])
    for x in rng.normal(size=(10, 3)):
        found = error(x, p, p)
        for value in (found.alpha, found.beta, found.output_error):
            assert value == pytest.approx(0, abs=1e-9)


def test_the_error_of_another_model_turns_one_into_the_other(make_plant: Any) -> None:
    """Nominal value + alpha mu + beta is the value by the other model, at u = control(mu) of the nominal one."""
    plant, rng = make_plant("segway"), np.random.default_rng(3)
    v, theta, omega = (plant.symbols[name] for name in ("v", "theta", "omega"))
    terms = Terms(plant.system, [Clf(theta), Barrier("slow", 3 - v - omega, (4,))])
    outputs = plant.system.derivatives("theta", theta, 2)[2]
    of_other = [*(quantity.value(plant.system.u) for quantity in terms.quantities), outputs]
    for x in rng.normal(size=(10, 3)):
        found, mu = model_error(terms)(x, np.array([60.0]), np.array([75.0])), rng.normal(size=1)
        nominal = [plant.number(term(mu), x, 0.0) for term in (terms.control, terms.nominal)]
        error = found.alpha @ mu + found.beta
        delta = Affine(found.output_error[:, :-1], found.output_error[:, -1])
        expected = [plant.number(value, x, nominal[0], body=75.0) for value in of_other]
        assert [*(nominal[1] + error), *(mu + delta(mu))] == pytest.approx(expected, rel=1e-9, abs=1e-9)
