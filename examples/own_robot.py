"""A robot of your own: a two-link arm reaches for a shelf it must not hit, half as heavy as its model.

M(q) q'' + h(q, q') = u from the Lagrangian L: M = d2L / dq'2, h = d2L / (dq' dq) q' - dL / dq. The outputs are the
joint angles minus a goal (relative degree 2), the barrier keeps the hand below z = 0.5 m. The mass is a parameter: the
true arm has another one than is believed. `model_error` says what that changes: y-ddot = mu + alpha mu + beta.
"""

import casadi as ca
import numpy as np
from cbf_clf_qp import Barrier, Clf, NumpyFunction, Tick, mechanical, model_error

SHELF, GOAL, DT = 0.5, np.array([1.2, 0.2]), 0.001  # m, rad, s; the hand at the goal would be at z = 0.96 m
LENGTH, INERTIA, GRAVITY, NOMINAL, TRUE = 0.5, 0.025, 9.81, 2.0, 1.0  # m; of a link / its mass, m^2; m/s^2; kg a link

q, dq, u, mass = ca.SX.sym("q", 2), ca.SX.sym("dq", 2), ca.SX.sym("u", 2), ca.SX.sym("mass")
angles = ca.vertcat(q[0], q[0] + q[1])
ends = [LENGTH * ca.vertcat(ca.cos(angle), ca.sin(angle)) for angle in ca.vertsplit(angles)]  # along each link, x and z
hand, energy = ends[0] + ends[1], ca.SX(0)
for angle, center in ((angles[0], ends[0] / 2), (angles[1], ends[0] + ends[1] / 2)):
    speed, turn = ca.jtimes(center, q, dq), ca.jtimes(angle, q, dq)
    energy += mass * (ca.sumsqr(speed) / 2 + INERTIA * turn**2 / 2 - GRAVITY * center[1])
momentum = ca.gradient(energy, dq)
M, h = ca.jacobian(momentum, dq), ca.jtimes(momentum, q, dq) - ca.gradient(energy, q)
arm = mechanical(q, dq, u, M, h, ca.SX.eye(2), parameters=[mass])


def reach(oracle: bool) -> float:
    """The hand's greatest height in 2 s on the true, light arm, m; `oracle` puts the true error in the QP."""
    tick = Tick(arm, [Clf(q - GOAL, eps=0.2), Barrier("shelf", SHELF - hand[1], poles=(15.0, 15.0))], solver="osqp")
    error, nominal, true = model_error(tick.terms), np.array([NOMINAL]), np.array([TRUE])
    rate = dq + DT * arm.x_dot[2:]
    later = {"x": ca.vertcat(q + DT * rate, rate), "height": hand[1]}
    motion = NumpyFunction.of("motion", {"x": arm.x, "u": u, "p": arm.p}, later)
    x, moves = np.array([-0.5, 0.3, 0.0, 0.0]), []
    for _ in range(round(2.0 / DT)):
        errors = error(x, nominal, true if oracle else nominal)
        torque = tick(x, errors.alpha, errors.beta, errors.output_error, mass=NOMINAL).u
        moves.append(motion(x, torque, true))
        x = moves[-1].x
    return max(move.height[0] for move in moves)


if __name__ == "__main__":
    for rows, height in (("nominal", reach(oracle=False)), ("true", reach(oracle=True))):
        verdict = "stays below" if height < SHELF + 5e-4 else "HITS"
        print(f"{rows} rows: hand up to {height:.4f} m, {verdict} the shelf at {SHELF} m")
