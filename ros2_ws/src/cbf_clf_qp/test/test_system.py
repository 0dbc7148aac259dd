"""Derivatives of a system against differences and identities; measured values against the exact derivative."""

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp.constraints import Barrier, Clf
from cbf_clf_qp.estimates import measure, model_error
from cbf_clf_qp.quantity import Quantity, Terms
from cbf_clf_qp.system import DegreeError, System, mechanical
from cbf_clf_qp.tick import Tick

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
    return System(x, u, ca.vertcat(x[1], x[2], u))


@pytest.mark.parametrize(("output", "given"), [(0, 2), (0, 1), (1, 1), (0, 4), (1, 3), (2, 2), (2, 3)])
def test_another_relative_degree_is_refused(chain: System, output: int, given: int) -> None:
    right = 3 - output
    said = f"derivative {given} does not depend on u" if given < right else f"relative degree {right}, but {given} was"
    with pytest.raises(DegreeError, match=f"wall: {said}"):
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


def test_relative_degree_3_is_not_measured(chain: System) -> None:
    """Remark 3; but it has rows."""
    for quantity in (Barrier("deep", chain.x[0], (1, 2, 3)), Clf(chain.x[0], gains=(1.0, 3.0, 3.0))):
        with pytest.raises(ValueError, match=r"(deep|V): one difference measures relative degrees 1 and 2 only"):
            measure(Terms(chain, [quantity]))


def test_a_sensor_is_read_as_the_tick_ends(chain: System) -> None:
    force = Quantity(("F",), chain.affine(chain.u), lambda _: [], sensor=2 * chain.x[2])
    terms = Terms(chain, [force])
    nothing = np.zeros(0)
    measured = measure(terms)(np.zeros(3), nothing, np.array([0.0, 0.0, 4.0]), nothing, np.array([SECONDS])).measured
    assert measured == pytest.approx([8])


def ball_on_a_beam() -> tuple[System, ca.SX]:
    """r'' = -rolling g sin(theta + tilt), theta'' = u; the ball's place r."""
    names = ("r", "theta", "dr", "dtheta", "u", "rolling", "tilt")
    r, theta, dr, dtheta, u, rolling, tilt = (ca.SX.sym(name) for name in names)
    rate = ca.vertcat(dr, dtheta, -rolling * 9.81 * ca.sin(theta + tilt), u)
    return System(ca.vertcat(r, theta, dr, dtheta), u, rate, [rolling, tilt]), r


def test_a_row_of_degree_4_has_the_derivatives_along_the_motion_and_the_poles() -> None:
    """Each derivative is the rate of the one before, by differences; the left side sums them with the gains."""
    system, r = ball_on_a_beam()
    poles = (3.0, 4.0, 5.0, 6.0)
    quantity = Barrier("end", 0.4 - r, poles).on(system)
    of = [system.x, system.u, system.p]
    chain = system.derivatives("end", 0.4 - r, 4)
    along = ca.Function("along", of, [ca.vertcat(*chain[:4], system.affine(chain[4])(system.u)), system.x_dot])
    left = ca.Function("left", of, [quantity.value(system.u)])
    rng, h, p = np.random.default_rng(0), 1e-6, np.array([5 / 7, 0.02])
    for _ in range(5):
        x, u = 0.3 * rng.normal(size=4), rng.normal(size=1)
        values, x_dot = (value.full().ravel() for value in along(x, u, p))
        ahead, behind = (along(x + t * x_dot, u, p)[0].full().ravel() for t in (h, -h))
        assert (ahead - behind)[:4] / (2 * h) == pytest.approx(values[1:], abs=1e-6)
        assert float(left(x, u, p)) == pytest.approx(np.poly(-np.array(poles))[::-1] @ values, rel=1e-12)


@pytest.mark.parametrize("name", ["segway", "ball on a beam"])
def test_the_error_of_another_model_turns_one_into_the_other(make_plant: Any, name: str) -> None:
    """Nominal value + alpha mu + beta is the value by the other model, at u = control(mu) of the nominal one.

    Of the ball, in rows of degree 4, all derivatives but the first two are the model's.
    """
    if name == "segway":
        plant = make_plant(name)
        system, y = plant.system, plant.symbols["theta"]
        quantities = [Clf(y), Barrier("slow", 3 - plant.symbols["v"] - plant.symbols["omega"], (4,))]
        degree, model, true = 2, np.array([60.0]), np.array([75.0])
    else:
        system, y = ball_on_a_beam()
        quantities = [Clf(y - 0.5, gains=(1.0, 4.0, 6.0, 4.0)), Barrier("end", 0.4 - y, (3, 4, 5, 6))]
        degree, model, true = 4, np.array([5 / 7, 0.0]), np.array([0.6, -0.05])
    terms = Terms(system, quantities)
    error, y_r = model_error(terms), system.affine(system.derivatives("y", y, degree)[-1])(system.u)
    wanted = ca.vertcat(*(quantity.value(system.u) for quantity in terms.quantities), y_r)
    values = ca.Function("values", [system.x, system.u, system.p], [wanted])
    mu = ca.SX.sym("mu")
    said = ca.Function("said", [system.x, mu, system.p], [terms.nominal(mu), terms.control(mu)])
    rng = np.random.default_rng(1)
    for _ in range(10):
        x, m = (1.0 if name == "segway" else 0.3) * rng.normal(size=system.x.numel()), rng.normal(size=1)
        found = error(x, model, true)
        nominal, u = (value.full().ravel() for value in said(x, m, model))
        expected = values(x, u, true).full().ravel()
        assert nominal + found.alpha @ m + found.beta == pytest.approx(expected[:2], rel=1e-9, abs=1e-9)
        assert m + found.output_error @ [*m, 1] == pytest.approx(expected[2:], rel=1e-9, abs=1e-9)


def test_outputs_that_are_fewer_than_the_inputs_have_no_error_and_the_quantities_have_theirs() -> None:
    """A puck of another mass, x'' = u_1 / m: so of u the error of V-dot is (m / m' - 1) times its nominal slope."""
    names = ("x", "z", "vx", "vz", "m")
    x, z, vx, vz, m = (ca.SX.sym(name) for name in names)
    u = ca.SX.sym("u", 2)
    puck = System(ca.vertcat(x, z, vx, vz), u, ca.vertcat(vx, vz, u / m), [m])
    tick, at, model = Tick(puck, [Clf(x), Barrier("wall", 1 - z, (4, 4))]), np.array([0.3, 0.1, -0.2, 0.4]), np.ones(1)
    found = model_error(tick.terms)(at, model, 2 * model)
    assert found.alpha == pytest.approx(-tick.look(at, model).nominal_a / 2, abs=1e-12)
    assert found.beta == pytest.approx(0, abs=1e-12)
    assert found.output_error.tolist() == np.zeros((2, 3)).tolist()
