"""Published examples of peers, with their own answers: the same input within 1e-6 of its size.

cbfpy 0.1.0 (D. Morton, MIT licence): its examples of an adaptive cruise control and of a point robot and obstacle, with
its solver ElastiQP. CBF-CLF-Helper (J. Choi, HybridRobotics): its adaptive cruise control, whose programme cbfpy solved
for us. The states are those of simulated drives, and random ones (seed 0); nothing of the peers' code is here.
"""

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp import HARD, Affine, Barrier, Clf, System, Tick, nearest

GRAVITY, MASS, TIME, DESIRED, DECELERATION = 9.81, 1650.0, 1.8, 24.0, 0.3  # m/s^2, kg, s, m/s, of g


def rows(text: str) -> list[tuple[float, ...]]:
    """Of numbers."""
    return [tuple(map(float, line.split())) for line in text.strip().splitlines()]


# v and v of the leader, m/s; distance, m; the wheels' force, N
CBFPY_CRUISE = rows("""
    20 14 100 3489.8196262
    22.521 14 85.066 1432.4116608
    23.416 14 66.968 366.5221273
    21.506 14 49.577 -2132.6458379
    16.399 14 30.523 -1347.2438451
    14.015 14 25.227 105.5339387
    25 26 60 -504.3642857
""")

HELPER_CRUISE = rows("""
    20 14 100 4855.95
    22.22 14 88.076 1060.5212879
    22.955 14 60.304 427.0198472
    21.181 14 46.89 -2569.9246163
    16.782 14 31.522 -1519.156632
    14.131 14 25.438 0.290334
""")

# position, speed of a robot of 1 kg; of an obstacle; the force: m, m/s, N
CBFPY_POINT = rows("""
    0.25 -0.41 -0.83 0.04 -0.21 0.14 1.31 0.36 -1.4 -0.19 0.01 -0.7 -0.29 0.62 0.69
    0.68 -0.79 -0.29 0.16 0.17 0.28 0.1 -1.11 -0.5 0.52 -0.15 0.1 -0.58284341 0.761879498 0.10310842
    0.81 -0.07 0.46 0.8 0.08 -0.25 0.5 -0.98 -0.6 0.17 0.39 -0.23 -2.63 -0.01 -0.21
    -0.17 0.74 -0.82 0.13 -0.14 -0.76 -0.26 0.05 0.1 0.03 -0.25 -0.15 0.04 -0.6 2.5
    -0.28 0.89 -0.33 0.43 0.02 0.37 0.35 1.93 -0.59 0.31 -0.58 -0.07 -0.15 -0.91 -0.04
    -0.2 -0.79 0.41 0.55 0.05 0.92 -1.32 0.03 0.13 0 -0.17 -0.26 -0.35 0.74 -1.91
    0.62 -0.14 0.86 -0.39 -0.01 0.01 0.19 -0.89 1.69 -0.11 -0.07 -0.16 -0.23 0.15 -0.87
    0.5 -0.59 0.14 0.31 0.41 -0.06 -0.2 0.06 0.65 0.63 -0.1 -0.34 0.26 -0.898304034 -0.926053934
""")


def cruise(rate: float, slack_weight: float, solver: str) -> Tick:
    """V = (v - DESIRED)^2 and B with V-dot <= -rate V + slack, B-dot >= -rate B; |(u - drag) / MASS|^2 is minimised."""
    v, leader, distance, u = (ca.SX.sym(name) for name in ("v", "leader", "distance", "u"))
    drag = 0.1 + 5 * v + 0.25 * v**2
    car = System(ca.vertcat(v, distance), u, ca.vertcat((u - drag) / MASS, leader - v), parameters=[leader])
    B = distance - TIME * v - (leader - v) ** 2 / (2 * DECELERATION * GRAVITY)
    return Tick(
        car,
        [
            Clf(v - DESIRED, eps=1 / rate, gains=(0.5,), slack_weight=slack_weight, in_mu=False),
            Barrier("B", B, poles=(rate,), rescue_weight=HARD),
        ],
        control=Affine.identity(1),
        limit=DECELERATION * MASS * GRAVITY,
        objective=lambda terms: nearest(terms.control, drag, 1 / MASS),
        solver=solver,
    )


@pytest.mark.parametrize("solver", ["daqp", "osqp"])
@pytest.mark.parametrize(("gains", "examples"), [((1.0, 5.0), CBFPY_CRUISE), ((5.0, 1e-2), HELPER_CRUISE)])
def test_cruise_control(solver: str, gains: tuple[float, float], examples: list[tuple[float, ...]]) -> None:
    tick = cruise(*gains, solver)
    for v, leader, distance, force in examples:
        decided = tick([v, distance], leader=leader)
        assert decided.solved
        assert decided.u == pytest.approx([force], rel=1e-6)


def point_robot(solver: str) -> Tick:
    """A PD law, corrected before an obstacle (relative degree 1, by the speed of approach) and before six walls (2)."""
    x, v, u, obstacle, speed = (ca.SX.sym(name, 3) for name in ("x", "v", "u", "obstacle", "speed"))
    between = x - obstacle
    distance = ca.norm_2(between)
    approach = ca.dot(speed - v, between / distance)
    walls = [1 - x, x + 1]
    return Tick(
        System(ca.vertcat(x, v), u, ca.vertcat(v, u), parameters={"obstacle": obstacle, "speed": speed}),
        [
            Barrier("obstacle", distance - 2 * approach - 0.25 - 0.25 - 0.1, poles=(3,), rescue_weight=HARD),
            *(Barrier(f"wall{k}{i}", walls[k][i], (1, 3), HARD) for k in range(2) for i in range(3)),
        ],
        objective=lambda terms: nearest(terms.control, -x - v),
        solver=solver,
    )


@pytest.mark.parametrize("solver", ["daqp", "osqp"])
def test_point_robot_and_obstacle_of_cbfpy(solver: str) -> None:
    tick, corrected = point_robot(solver), 0
    for example in CBFPY_POINT:
        x, obstacle, speed, force = np.split(np.array(example), [6, 9, 12])
        decided = tick(x, obstacle=obstacle, speed=speed)
        assert decided.solved
        assert decided.u == pytest.approx(force, abs=1e-6)
        corrected += bool(decided.active)
    assert corrected >= 4
