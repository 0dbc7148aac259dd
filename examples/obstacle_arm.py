"""A two-link arm with an unknown payload must not touch an obstacle that moves, while it follows a target.

M(q) q'' + h(q, q') = u from the Lagrangian, a payload at the hand; the model believes in none
CLF:      y = q - the goal;      barrier: distance of the hand from the obstacle's rim
"""

import casadi as ca
import numpy as np
from cbf_clf_qp import Barrier, Clf, mechanical
from own_systems import ControlTask, Disc, Line

LENGTH, MASS, INERTIA, GRAVITY, RIM = 0.5, 2.0, 0.025, 9.81, 0.15  # m; of a link, kg; / its mass, m^2; m/s^2; m

q, dq, u, payload, friction = (
    *(ca.SX.sym(name, 2) for name in ("q", "dq", "u")),
    ca.SX.sym("payload"),
    ca.SX.sym("friction"),
)
goal, place, speed = ([ca.SX.sym(f"{name}_{i}") for i in "xz"] for name in ("goal", "obstacle", "speed"))
angles = ca.vertcat(q[0], q[0] + q[1])
ends = [LENGTH * ca.vertcat(ca.cos(angle), ca.sin(angle)) for angle in ca.vertsplit(angles)]
hand, lagrangian = ends[0] + ends[1], ca.SX(0)
away = hand - ca.vertcat(*place)  # from the obstacle
names = "q1", "q2", "dq1", "dq2", "away_x", "away_z"
observed = zip(names, ca.vertsplit(ca.vertcat(q, dq, away / ca.norm_2(away))), strict=True)
for mass, centre, angle in (
    (MASS, ends[0] / 2, angles[0]),
    (MASS, ends[0] + ends[1] / 2, angles[1]),
    (payload, hand, 0),
):
    rate, turn = ca.jtimes(centre, q, dq), ca.jtimes(ca.SX(angle), q, dq)
    lagrangian += mass * (ca.sumsqr(rate) / 2 + INERTIA * turn**2 / 2 - GRAVITY * centre[1])
momentum = ca.gradient(lagrangian, dq)
M, h = ca.jacobian(momentum, dq), ca.jtimes(momentum, q, dq) - ca.gradient(lagrangian, q) + friction * dq
ARM = mechanical(
    q, dq, u, M, h, ca.SX.eye(2), parameters=[payload, friction, *goal, *place, *speed],
    rates={symbol.name(): rate for symbol, rate in zip(place, speed, strict=True)},
)  # fmt: skip


def commands(rng: np.random.Generator):
    """The goal moves slowly, and the obstacle on a circle through the hand's way."""
    turn, begin, wide = rng.uniform(1.0, 1.6), rng.uniform(0, 2 * np.pi), rng.uniform(0.1, 0.2)

    def at(t):
        angle = turn * t + begin
        place = np.array([0.95, 0.05]) + wide * np.array([np.cos(angle), np.sin(angle)])
        speed = wide * turn * np.array([-np.sin(angle), np.cos(angle)])
        goal = 0.2 * np.sin(0.8 * t) - 0.4, 1.2
        return dict(zip((s.name() for s in (*goal_symbols, *obstacle_symbols)), (*goal, *place, *speed), strict=True))

    return at


goal_symbols, obstacle_symbols = goal, [*place, *speed]


def draw(x, p):
    """The arm and the obstacle."""
    elbow = LENGTH * np.array([np.cos(x[0]), np.sin(x[0])])
    tip = elbow + LENGTH * np.array([np.cos(x[0] + x[1]), np.sin(x[0] + x[1])])
    return [
        Line(np.array([[0, 0], elbow, tip]), "tab:blue", 5),
        Disc(np.array([p["obstacle_x"], p["obstacle_z"]]), RIM),
    ]


TASK = ControlTask(
    "obstacle-arm",
    ARM,
    [Clf(q - ca.vertcat(*goal), eps=0.3), Barrier("obstacle", ca.norm_2(away) - RIM, poles=(12.0, 12.0))],
    nominal={"payload": 0.0, "friction": 0.0},
    true={"payload": 1.0, "friction": 1.0},
    start=((-0.4, 1.2, 0, 0), (-0.2, 1.4, 0, 0)),
    commands=commands,
    duration=6.0,
    limit=60.0,
    observation=dict(observed),
    coordinates=("shoulder", "elbow"),
    inputs=("shoulder", "elbow"),
    draw=draw,
)
