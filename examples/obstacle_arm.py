"""A two-link arm that lifts an unknown payload follows a goal, and its hand must not touch an obstacle that moves.

M(q) q'' + h(q, q') = u   from the Lagrangian, with a payload at the hand; the model believes in none
CLF: y = q - goal;   barrier: the hand's distance from the obstacle's rim; a policy reads q, q', d distance / dq
"""

from collections.abc import Mapping
from functools import partial

import casadi as ca
import numpy as np
from cbf_clf_qp import Barrier, Clf, mechanical
from rabbit_description.task import ControlTask, Disc, Line, Shape

LENGTH, MASS, INERTIA, GRAVITY, RIM = 0.5, 2.0, 0.025, 9.81, 0.15  # m; of a link, kg; / its mass, m^2; m/s^2; m

q, dq, u = (ca.SX.sym(name, 2) for name in ("q", "dq", "u"))
names = "payload", "friction", "goal_1", "goal_2", "place_x", "place_z", "speed_x", "speed_z"
payload, friction, *goal, place_x, place_z, speed_x, speed_z = p = [ca.SX.sym(name) for name in names]
elbow, lower = (LENGTH * ca.vertcat(ca.cos(angle), ca.sin(angle)) for angle in (q[0], q[0] + q[1]))
hand, lagrangian = elbow + lower, ca.SX(0)
distance = ca.norm_2(hand - ca.vertcat(place_x, place_z)) - RIM
links = (MASS, elbow / 2, q[0]), (MASS, elbow + lower / 2, q[0] + q[1]), (payload, hand, ca.SX(0))
for mass, centre, angle in links:
    rate, turn = ca.jtimes(centre, q, dq), ca.jtimes(angle, q, dq)
    lagrangian += mass * (ca.sumsqr(rate) / 2 + INERTIA * turn**2 / 2 - GRAVITY * centre[1])
momentum = ca.gradient(lagrangian, dq)
M, h = ca.jacobian(momentum, dq), ca.jtimes(momentum, q, dq) - ca.gradient(lagrangian, q) + friction * dq
read = ca.vertsplit(ca.vertcat(q, dq, ca.gradient(distance, q)))


def at(rate: float, begin: float, wide: float, t: float) -> dict[str, float]:
    """The goal moves slowly, and the obstacle, which begins away from the hand, on a circle through its way."""
    cos, sin = wide * np.cos(rate * t + begin), wide * np.sin(rate * t + begin)
    values = 0.2 * np.sin(0.8 * t) - 0.4, 1.2, 0.95 + cos, 0.05 + sin, -rate * sin, rate * cos
    return dict(zip(names[2:], values, strict=True))


def draw(x: np.ndarray, p: Mapping[str, float]) -> list[Shape]:
    """The arm and the obstacle."""
    ends = LENGTH * np.array([[np.cos(angle), np.sin(angle)] for angle in (x[0], x[0] + x[1])])
    arm, obstacle = np.vstack([(0, 0), ends.cumsum(axis=0)]), np.array([p["place_x"], p["place_z"]])
    return [Line(arm, "tab:blue", 5), Disc(obstacle, RIM)]


TASK = ControlTask(
    "obstacle-arm",
    mechanical(q, dq, u, M, h, ca.SX.eye(2), parameters=p, rates={"place_x": speed_x, "place_z": speed_z}),
    [Clf(q - ca.vertcat(*goal), eps=0.1), Barrier("obstacle", distance, poles=(18.0, 18.0))],
    nominal={"payload": 0.0, "friction": 0.0},
    true={"payload": 1.0, "friction": 1.0},
    start=((-0.4, 1.2, 0, 0), (-0.2, 1.4, 0, 0)),
    commands=lambda rng: partial(at, rng.uniform(1.0, 1.6), rng.uniform(-1.5, 0.8), rng.uniform(0.1, 0.2)),
    duration=12.0,
    limit=60.0,
    observation=dict(zip(("q1", "q2", "dq1", "dq2", "slope1", "slope2"), read, strict=True)),
    coordinates=("shoulder", "elbow"),
    inputs=("shoulder", "elbow"),
    draw=draw,
)
