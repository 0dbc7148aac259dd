"""A tick: nothing in it is stale, estimates, corners and what comes in at its door."""

from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.constraints import Barrier, Clf
from cbf_clf_qp.estimates import model_error
from cbf_clf_qp.quantity import HARD, Quantity, Terms
from cbf_clf_qp.system import System
from cbf_clf_qp.tick import Tick

X, V, U, FORCE = ca.SX.sym("x"), ca.SX.sym("v"), ca.SX.sym("u"), 100.0
DEFAULTS = {"wall": 0.9, "speed": 0.0, "eps": 0.2, "pole": 8.0, "radius": 0.1, "limit": FORCE, "weight": 10.0}
DEFAULTS["mass"] = 2.0


def cart_tick(solver: str = "daqp", **constants: float) -> Tick:
    """A cart that is pulled to 1 m, before a wall and a round obstacle; what is not constant is a parameter."""
    of: dict[str, Any] = {name: constants.get(name, ca.SX.sym(name)) for name in DEFAULTS}
    parameters = [value for value in of.values() if isinstance(value, ca.SX)]
    rates = {"wall": of["speed"]} if isinstance(of["wall"], ca.SX) else {}
    cart = System(ca.vertcat(X, V), U, ca.vertcat(V, U / of["mass"]), parameters, rates)
    quantities = [
        Clf(X - 1, eps=of["eps"], slack_weight=of["weight"]),
        Barrier("wall", of["wall"] - X, poles=(of["pole"], of["pole"])),
        Barrier("obstacle", (X + 1) ** 2 - of["radius"] ** 2, poles=(of["pole"], 2 * of["pole"])),
    ]
    return Tick(cart, quantities, limit=of["limit"], solver=solver)


CHANGES = {"wall": 0.5, "eps": 0.4, "pole": 2.0, "radius": 0.8, "limit": 3.0, "weight": 1.0, "mass": 7.0}


@pytest.mark.parametrize("solver", ["daqp", "osqp"])
@pytest.mark.parametrize("name", CHANGES)
def test_a_changed_parameter_counts_in_the_same_tick(solver: str, name: str) -> None:
    """As in a tick that is built with that constant; there and back, in the middle of a ride."""
    tick, rng = cart_tick(solver), np.random.default_rng(0)
    fixed = {value: cart_tick(solver, **{**DEFAULTS, name: value}) for value in (DEFAULTS[name], CHANGES[name])}
    differ = 0
    for k in range(60):
        x = rng.normal(size=2)
        value = CHANGES[name] if 20 <= k < 40 else DEFAULTS[name]
        decided = tick(x, **{**DEFAULTS, name: value})
        assert decided.solved
        assert decided.u == pytest.approx(fixed[value](x).u, rel=1e-6, abs=1e-6)
        differ += abs(decided.u[0] - tick(x, **DEFAULTS).u[0]) > 1e-3
    assert differ > 3


@pytest.mark.parametrize(
    "wall_of",
    [lambda t: (0.9 if t < 0.02 else 0.5, 0.0), lambda t: (0.9 - 0.3 * t, -0.3)],
    ids=["moved while the cart can still stop", "comes closer at known speed"],
)
def test_a_wall_that_has_moved_or_comes_closer_is_not_passed(wall_of: Callable[[float], tuple[float, float]]) -> None:
    """`wall_of` gives its place and speed at a time; of a speed that is not declared: `test_readme.py`."""
    tick, x = cart_tick(), np.zeros(2)
    for k in range(2000):
        wall, speed = wall_of(k / 1000)
        decided = tick(x, **{**DEFAULTS, "wall": wall, "speed": speed})
        assert decided.solved
        acceleration = decided.u[0] / 2
        x = x + np.array([x[1] / 1000 + acceleration / 2e6, acceleration / 1000])
        assert wall_of((k + 1) / 1000)[0] - x[0] > -1e-3


@pytest.mark.parametrize("solver", ["daqp", "osqp"])
@pytest.mark.parametrize("limit", [1e-4, 1e-2, 1.0, 1e4])
def test_a_limit_of_the_input_is_kept(solver: str, limit: float) -> None:
    """Within a part of it, also where it is far smaller than what the rows would need."""
    tick, rng, reached = cart_tick(solver), np.random.default_rng(6), 0
    for x in rng.normal(size=(50, 2)):
        decided = tick(x, **{**DEFAULTS, "limit": limit})
        assert decided.solved
        assert abs(decided.u[0]) <= limit * (1 + 1e-4)
        reached += "u1" in decided.active
    assert reached > 25 or limit > 1


def segway_tick(plant: Any, **options: Any) -> Tick:
    v, theta, omega = (plant.symbols[name] for name in ("v", "theta", "omega"))
    slow = Barrier("slow", 3 - v - 1.2 * ca.cos(theta) * omega - 4 * ca.sin(theta), poles=(4,))
    return Tick(plant.system, [Clf(theta - 0.1), slow], **options)


@pytest.mark.parametrize("solver", ["daqp", "osqp"])
def test_estimates_make_the_tick_that_of_another_model(make_plant: Any, solver: str) -> None:
    """y^(r) = mu of the nominal model; the other's rows, at the same mu."""
    plant, rng = make_plant("segway"), np.random.default_rng(1)
    tick, nominal = segway_tick(plant, solver=solver), ca.SX(60.0)
    theta = plant.symbols["theta"]
    control = Terms(plant.system, [Clf(theta - 0.1)]).control
    control = Affine(*ca.substitute([control.a, control.b], [plant.symbols["body"]], [nominal]))
    other = segway_tick(plant, solver=solver, control=control)
    error = model_error(tick.terms)
    for x in rng.normal(size=(20, 3)) * [1, 0.3, 0.3]:
        found = error(x, np.array([60.0]), np.array([75.0]))
        decided = tick(x, alpha=found.alpha, beta=found.beta, body=60.0)
        assert decided.u == pytest.approx(other(x, body=75.0).u, rel=1e-6, abs=1e-6)


def test_a_correction_of_the_input_is_a_part_of_it(make_plant: Any) -> None:
    """u = control(mu + alpha mu + beta) with the nominal rows over mu."""
    plant, rng = make_plant("double_pendulum"), np.random.default_rng(2)
    clf = Clf(plant.symbols["q"], eps=0.2)
    V = clf.on(plant.system)
    assert V.outputs
    assert V.slope
    slope = V.slope
    outputs = Quantity(("y1", "y2"), V.outputs, lambda y_r: V.rows(slope.after(y_r)), outputs=V.outputs)
    nominal, corrected = Tick(plant.system, [clf]), Tick(plant.system, [outputs], corrects_input=True, limit=40.0)
    limited = 0
    for x in rng.normal(size=(20, 4)):
        alpha, beta = 0.1 * rng.normal(size=(2, 2)), rng.normal(size=2)
        decided, read = corrected(x, alpha=alpha, beta=beta, tip=0.5), corrected.look(x, np.array([0.5]))
        assert decided.solved
        expected = read.control_a @ (decided.mu + alpha @ decided.mu + beta) + read.control_b
        assert decided.u == pytest.approx(expected, rel=1e-9)
        assert np.abs(decided.u).max() <= 40 + 1e-6
        is_free = decided.active in ((), ("CLF",))
        limited += not is_free
        if is_free:
            assert decided.mu == pytest.approx(nominal(x, tip=0.5).mu, abs=1e-5)
    assert 0 < limited < 20


def test_each_corner_has_its_rows() -> None:
    """The mu that a barrier asks for, if its error is one of two, is that of the worse one."""
    x, u = ca.SX.sym("x"), ca.SX.sym("u")
    system, barrier = System(x, u, u), Barrier("far", x - 1, (1,), rescue_weight=HARD)

    def corners(terms: Terms) -> list[Affine]:
        return [Affine(ca.SX(sign * 0.5), ca.SX(sign * 0.2)) for sign in (-1, 1)]

    tick = Tick(system, [barrier], corners=corners)
    assert tick.layout.names == ("far", "far")
    for place in (0.0, -2.0, 3.0):  # mu (1 +- 0.5) +- 0.2 >= 1 - x
        least = 1 - place
        expected = max(0.0, (least + 0.2) / 0.5, (least - 0.2) / 1.5)
        assert tick([place]).mu == pytest.approx([expected], abs=1e-6)
    soft = Tick(system, [Barrier("far", x - 1, (1,))], corners=corners, limit=1.0)
    slack = soft([0.0]).slack["far"] * 0.5  # of the row of size 0.5, in units of mu
    assert slack == pytest.approx(1.2 - 0.5, rel=1e-4)


@pytest.mark.parametrize("solver", ["daqp", "osqp"])
@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"wall": float("nan")}, r"wall = \[nan\]: expected finite"),
        ({"x": [0.0, float("nan")]}, r"x = \[ 0. nan\]: expected finite"),
        ({"beta": np.array([0, np.inf, 0])}, "beta = .*expected finite"),
        ({"x": [0.0]}, "x has 1 numbers; expected 2"),
        ({"x": [0.0, 0, 0]}, "x has 3 numbers; expected 2"),
        ({"alpha": np.zeros((3, 2))}, "alpha has 6 numbers; expected 3"),
        ({"wall": "far"}, "parameter wall = far: expected numbers"),
        ({"gate": 1.0}, "parameters: gate unknown; expected wall, speed"),
    ],
)
def test_what_is_wrong_at_the_door_is_one_clear_error(solver: str, changes: dict[str, Any], named: str) -> None:
    """And the next tick is as if it had not been asked."""
    tick, right = cart_tick(solver), {"x": [0.3, 0.1], **DEFAULTS}
    before = tick(**right).u
    with pytest.raises(ValueError, match=named):
        tick(**{**right, **changes})
    assert tick(**right).u == pytest.approx(before, abs=0)


def test_a_matrix_is_a_parameter() -> None:
    """Row by row, as numpy has it."""
    x, u, A = ca.SX.sym("x", 2), ca.SX.sym("u", 2), ca.SX.sym("A", 2, 2)
    tick = Tick(System(x, u, A @ x + u, {"A": A}), [Clf(x, gains=(1.0,))])
    matrix = np.array([[1.0, 2.0], [3.0, 4.0]])
    decided = tick([0.3, -0.7], A=matrix)
    assert decided.u + matrix @ [0.3, -0.7] == pytest.approx(decided.mu)
    with pytest.raises(ValueError, match=r"parameter A = .*expected numbers of shape \(2, 2\)"):
        tick([0.3, -0.7], A=[1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("names", "refused"),
    [(("wall", "wall"), "expected different names"), (("wall", "w" * 33), "quantity w{33}: expected a name of 32")],
)
def test_a_name_that_no_message_could_tell_apart_or_hold_is_refused(names: tuple[str, str], refused: str) -> None:
    cart = System(ca.vertcat(X, V), U, ca.vertcat(V, U))
    with pytest.raises(ValueError, match=refused):
        Tick(cart, [Barrier(name, 1 - X, poles=(8, 8)) for name in names])
    Tick(cart, [Barrier(name, 1 - X, poles=(8, 8)) for name in ("wall", "w" * 32)])
