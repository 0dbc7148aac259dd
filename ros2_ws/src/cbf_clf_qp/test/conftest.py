"""Four systems that the tests share: a cart before a wall, a pendulum, a Segway, a double pendulum."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import pytest
from cbf_clf_qp.system import System, mechanical

GRAVITY = 9.81


@dataclass(frozen=True)
class Plant:
    """A system, its state's symbols by name, and a value of each parameter."""

    system: System
    symbols: dict[str, ca.SX]
    values: dict[str, float]

    def number(self, expression: ca.SX, x: Any, u: Any, **parameters: Any) -> Any:
        """An expression's value."""
        of = {**self.values, **parameters}
        function = ca.Function("f", [self.system.x, self.system.u, self.system.p], [expression])
        value = function(x, u, [of[name] for name in self.system.named]).full()
        return value.ravel() if value.size > 1 else value.item()


def symbols(*names: str) -> dict[str, ca.SX]:
    """By name."""
    return {name: ca.SX.sym(name) for name in names}


def cart() -> Plant:
    """Position x, speed v, force u; the wall moves at `speed`."""
    x, v, u, mass, wall, speed = (s := symbols("x", "v", "u", "mass", "wall", "speed")).values()
    system = System(ca.vertcat(x, v), u, ca.vertcat(v, u / mass), [mass, wall, speed], rates={"wall": speed})
    return Plant(system, s, {"mass": 2.0, "wall": 0.9, "speed": 0.0})


def pendulum() -> Plant:
    """Angle theta from upright, rate omega, torque u."""
    theta, omega, u, length = (s := symbols("theta", "omega", "u", "length")).values()
    x_dot = ca.vertcat(omega, GRAVITY / length * ca.sin(theta) + u)
    return Plant(System(ca.vertcat(theta, omega), u, x_dot, [length]), s, {"length": 0.7})


def segway() -> Plant:
    """Speed v, lean theta, its rate omega, torque u."""
    v, theta, omega, u, body = (s := symbols("v", "theta", "omega", "u", "body")).values()
    coupling = body * 0.8 * ca.cos(theta)
    mass = ca.vertcat(ca.horzcat(body + 12, coupling), ca.horzcat(coupling, 5 + body * 0.64))
    forces = body * 0.8 * ca.sin(theta) * ca.vertcat(omega**2, GRAVITY) + ca.vertcat(5, -1) * u
    v_dot, omega_dot = ca.vertsplit(ca.solve(mass, forces))
    x_dot = ca.vertcat(v_dot, omega, omega_dot)
    return Plant(System(ca.vertcat(v, theta, omega), u, x_dot, [body]), s, {"body": 60.0})


def double_pendulum() -> Plant:
    """Two angles from below, absolute, of two rods without mass, 1 m long, with a mass of 1 kg and one of `tip`."""
    q, dq, u, tip = ca.SX.sym("q", 2), ca.SX.sym("dq", 2), ca.SX.sym("u", 2), ca.SX.sym("tip")
    difference = q[0] - q[1]
    coupling = tip * ca.cos(difference)
    M = ca.vertcat(ca.horzcat(1 + tip, coupling), ca.horzcat(coupling, tip))
    h = ca.vertcat(
        tip * ca.sin(difference) * dq[1] ** 2 + (1 + tip) * GRAVITY * ca.sin(q[0]),
        -tip * ca.sin(difference) * dq[0] ** 2 + tip * GRAVITY * ca.sin(q[1]),
    )
    system = mechanical(q, dq, u, M, h, ca.SX.eye(2), parameters=[tip])
    return Plant(system, {"q": q, "dq": dq, "tip": tip, "u": u}, {"tip": 0.5})


PLANTS: dict[str, Callable[[], Plant]] = {of.__name__: of for of in (cart, pendulum, segway, double_pendulum)}


@pytest.fixture
def make_plant() -> Callable[[str], Plant]:
    """By name."""
    return lambda name: PLANTS[name]()
