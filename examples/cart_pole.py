"""A cart-pole that must not pass a wall: the pole is heavier than its model, and the cart drags.

    CLF:      y = theta - the lean that is asked for
    barrier:  wall - (where the pole's tip is going) >= 0

To stop, the cart must run ahead of the pole. A limit on the tip f = x + LENGTH sin(theta) alone has relative degree 4:
the barrier looks ahead: f + 3 T f' + 3 T^2 f'' + T^3 f''' stays before the wall, and then so does f.
"""

from collections.abc import Mapping

import casadi as ca
import numpy as np
from cbf_clf_qp import Barrier, Clf, mechanical
from rabbit_description.task import Commands, ControlTask, Disc, Line, Shape

LENGTH, GRAVITY, AHEAD = 0.8, 9.81, 0.25  # m; m/s^2; T, s
q, dq, force = ca.SX.sym("q", 2), ca.SX.sym("dq", 2), ca.SX.sym("force")
cart, pole, drag, lean, wall = p = [ca.SX.sym(name) for name in ("cart", "pole", "drag", "lean", "wall")]
(x, theta), (v, omega) = ca.vertsplit(q), ca.vertsplit(dq)
sin, cos = ca.sin(theta), ca.cos(theta)
M = ca.blockcat([[cart + pole, pole * LENGTH * cos], [pole * LENGTH * cos, pole * LENGTH**2]])
h = ca.vertcat(drag * v - pole * LENGTH * sin * omega**2, -pole * LENGTH * GRAVITY * sin)
goes_to = x + LENGTH * sin + 3 * AHEAD * (v + LENGTH * cos * omega)
goes_to += 3 * AHEAD**2 * GRAVITY * sin + AHEAD**3 * GRAVITY * cos * omega


def commands(rng: np.random.Generator) -> Commands:
    """The lean that is asked for, towards the wall."""
    asked, begin = rng.uniform(0.03, 0.06), rng.uniform(0.2, 0.6)
    return lambda t: {"lean": asked if t > begin else 0.0, "wall": 2.0}


def draw(x: np.ndarray, p: Mapping[str, float]) -> list[Shape]:
    """The cart, the pole, the wall."""
    cart, tip = np.array([x[0], 0.0]), np.array([x[0] + LENGTH * np.sin(x[1]), LENGTH * np.cos(x[1])])
    box = cart + np.array([[-0.15, -0.05], [0.15, -0.05], [0.15, 0.05], [-0.15, 0.05], [-0.15, -0.05]])
    wall = np.array([[p["wall"], -0.1], [p["wall"], 1.0]])
    return [Line(wall, "tab:red"), Line(box), Line(np.array([cart, tip]), "tab:blue"), Disc(tip, 0.05, "tab:blue")]


TASK = ControlTask(
    "cart-pole",
    mechanical(q, dq, force, M, h, ca.SX([1, 0]), parameters=p),
    [Clf(theta - lean, eps=0.3), Barrier("wall", wall - goes_to, poles=(3.0,))],
    nominal={"cart": 1.0, "pole": 0.4, "drag": 0.0},
    true={"cart": 1.4, "pole": 0.7, "drag": 1.0},
    start=((-0.2, -0.03, 0.0, 0.0), (0.2, 0.03, 0.0, 0.0)),
    commands=commands,
    duration=8.0,
    failed=ca.fabs(theta) - 1.0,
    coordinates=("x", "theta"),
    inputs=("force",),
    draw=draw,
)
