"""Derivatives of a system against finite differences and identities; what is wrong with it has one clear error."""

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp.constraints import Barrier
from cbf_clf_qp.system import DegreeError, System, mechanical

OUTPUTS: dict[str, Callable[[Any], ca.SX]] = {
    "cart": lambda s: ca.sin(s["x"]) * s["wall"] - s["v"] ** 2 * s["mass"],
    "pendulum": lambda s: ca.cos(s["theta"]) + s["omega"] ** 3 * s["length"],
    "segway": lambda s: s["v"] + 1.2 * ca.cos(s["theta"]) * s["omega"] + ca.exp(s["theta"]),
    "double_pendulum": lambda s: ca.dot(ca.sin(s["q"]), s["dq"]) + s["tip"] * s["q"][0],
}


@pytest.mark.parametrize("name", OUTPUTS)
def test_a_derivative_is_the_difference_along_the_flow(make_plant: Any, name: str) -> None:
    plant, rng, h = make_plant(name), np.random.default_rng(1), 1e-6
    y = OUTPUTS[name](plant.symbols)
    y_dot = plant.system.derivative(y)
    for _ in range(20):
        x, u = rng.normal(size=plant.system.x.numel()), 10 * rng.normal(size=plant.system.u.numel())
        x_dot = plant.number(plant.system.x_dot, x, u)
        ahead, behind = (plant.number(y, x + t * x_dot, u) for t in (h, -h))
        assert plant.number(y_dot, x, u) == pytest.approx((ahead - behind) / (2 * h), rel=1e-6, abs=1e-6)


def test_the_power_of_a_double_pendulum_is_that_of_its_torques(make_plant: Any) -> None:
    """E-dot = q-dot' u: an identity of M, h and the derivative, for every state and torque."""
    plant, rng = make_plant("double_pendulum"), np.random.default_rng(2)
    q, dq, tip = (plant.symbols[name] for name in ("q", "dq", "tip"))
    speeds = dq[0] ** 2 * (1 + tip) / 2 + dq[1] ** 2 * tip / 2 + tip * dq[0] * dq[1] * ca.cos(q[0] - q[1])
    heights = -(1 + tip) * 9.81 * ca.cos(q[0]) - tip * 9.81 * ca.cos(q[1])
    power = plant.system.derivative(speeds + heights)
    for _ in range(20):
        x, u = rng.normal(size=4), rng.normal(size=2)
        assert plant.number(power, x, u) == pytest.approx(x[2:] @ u, rel=1e-9, abs=1e-9)


def test_a_wall_that_moves_is_in_both_derivatives(make_plant: Any) -> None:
    """B = wall - x: B-dot = speed - v, B-ddot = -u / mass; squared, B-ddot has 2 (speed - v)^2 too."""
    plant, rng = make_plant("cart"), np.random.default_rng(3)
    B = plant.symbols["wall"] - plant.symbols["x"]
    _, dB, ddB = plant.system.derivatives("wall", B, 2)
    *_, ddB_squared = plant.system.derivatives("squared", B**2, 2)
    for x, v, u, wall, speed in rng.normal(size=(20, 5)):
        at: Any = ([x, v], u)
        parameters = {"wall": wall, "speed": speed}
        assert plant.number(dB, *at, **parameters) == pytest.approx(speed - v)
        assert plant.number(ddB, *at, **parameters) == pytest.approx(-u / 2)
        expected = 2 * (speed - v) ** 2 + 2 * (wall - x) * -u / 2
        assert plant.number(ddB_squared, *at, **parameters) == pytest.approx(expected)


@pytest.fixture
def chain() -> System:
    """x''' = u."""
    x, u = ca.SX.sym("x", 3), ca.SX.sym("u")
    return System(x, u, ca.vertcat(x[1], x[2], u), [ca.SX.sym("limit")])


@pytest.mark.parametrize("degree", [1, 2, 3])
def test_each_relative_degree_has_its_row(chain: System, degree: int) -> None:
    """s^r + K (1, ..., s^(r-1)) = prod (s + p_i): for poles 1, 2, 3 the coefficients are known."""
    gains = {1: [1], 2: [2, 3], 3: [6, 11, 6]}[degree]
    x = np.array([0.3, -0.2, 0.7])[3 - degree :]
    quantity = Barrier("B", chain.x[3 - degree], poles=(1, 2, 3)[:degree]).on(chain)
    (row,) = quantity.rows(quantity.value)
    bound = ca.Function("f", [chain.x], [-row.upper])(np.array([0.3, -0.2, 0.7]))
    assert float(bound) == pytest.approx(-np.dot(gains, x))
    assert row.A.is_constant()
    assert float(row.A) == -1  # -u <= K x


@pytest.mark.parametrize(("output", "given"), [(0, 2), (0, 1), (1, 1)])
def test_a_relative_degree_that_is_too_low_is_refused(chain: System, output: int, given: int) -> None:
    with pytest.raises(DegreeError, match=f"wall: derivative {given} does not depend on u"):
        Barrier("wall", chain.x[output], poles=(1.0,) * given).on(chain)


@pytest.mark.parametrize(("output", "given"), [(0, 4), (1, 3), (2, 2), (2, 3)])
def test_a_relative_degree_that_is_too_high_is_refused(chain: System, output: int, given: int) -> None:
    with pytest.raises(DegreeError, match=f"wall: relative degree {3 - output}, but {given} was given"):
        Barrier("wall", chain.x[output], poles=(1.0,) * given).on(chain)


def test_the_relative_degree_counts_what_cancels() -> None:
    """Only the second joint of a double pendulum has a motor: its angular momentum has relative degree 3."""
    q, dq, u = ca.SX.sym("q", 2), ca.SX.sym("dq", 2), ca.SX.sym("u")
    c = ca.cos(q[1])
    M = ca.vertcat(ca.horzcat(3 + 2 * c, 1 + c), ca.horzcat(1 + c, 1))
    s = ca.sin(q[1])
    h = ca.vertcat(-s * dq[1] * (2 * dq[0] + dq[1]), s * dq[0] ** 2)
    h += 9.81 * ca.vertcat(2 * ca.sin(q[0]) + ca.sin(q[0] + q[1]), ca.sin(q[0] + q[1]))
    acrobot = mechanical(q, dq, u, M, h, ca.vertcat(0, 1))
    momentum = (M @ dq)[0]
    _, rate, *_ = acrobot.derivatives("momentum", momentum, 3)
    of_gravity = -9.81 * (2 * ca.sin(q[0]) + ca.sin(q[0] + q[1]))
    difference = ca.Function("f", [acrobot.x], [rate - of_gravity])
    for x in np.random.default_rng(4).normal(size=(10, 4)):
        assert float(difference(x)) == pytest.approx(0, abs=1e-9)


def test_what_is_not_declared_is_named() -> None:
    x, u, mass = ca.SX.sym("x"), ca.SX.sym("u"), ca.SX.sym("mass")
    with pytest.raises(ValueError, match="x_dot depends on mass"):
        System(x, u, u / mass)
    with pytest.raises(ValueError, match="the rate of wall depends on mass"):
        System(x, u, u, [ca.SX.sym("wall")], rates={"wall": mass})
    with pytest.raises(ValueError, match="rates of wal: expected parameters, wall"):
        System(x, u, u, [ca.SX.sym("wall")], rates={"wal": mass})
    with pytest.raises(ValueError, match="B depends on mass"):
        System(x, u, u).derivatives("B", x * mass, 1)
    with pytest.raises(ValueError, match="B depends on x"):  # another symbol of that name
        System(x, u, u).derivatives("B", ca.SX.sym("x"), 1)
