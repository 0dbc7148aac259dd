"""A robot of your own: a two-link arm reaches for a shelf it must not hit, half as heavy as believed.

The dynamics are M(q) q'' + h(q, q') = u, from the Lagrangian L = kinetic - potential energy:

    M = d2L / dq'2,    h = d2L / (dq' dq) q' - dL / dq

The outputs are the joint angles minus a goal (relative degree 2), the barrier keeps the hand below z = 0.5 m. The arm's
mass is a parameter: the controller believes in 2 kg a link, the true arm has 1 kg, and `model_error` says what that
changes: y-ddot = mu + alpha mu + beta.
"""

import casadi as ca
import numpy as np
from cbf_clf_qp.barrier import Barrier
from cbf_clf_qp.clf import Clf
from cbf_clf_qp.estimates import Estimates, model_error
from cbf_clf_qp.functions import NumpyFunction
from cbf_clf_qp.system import mechanical
from cbf_clf_qp.tick import Tick

SHELF, GOAL, DT = 0.5, np.array([1.2, 0.2]), 0.001  # m, rad, s; the hand at the goal would be at z = 0.96 m
LENGTH, INERTIA, GRAVITY = 0.5, 0.025, 9.81  # m; of a link about its centre, m^2 times its mass; m/s^2
BELIEVED, TRUE = 2.0, 1.0  # kg, of each link

q, dq, u, mass = ca.SX.sym("q", 2), ca.SX.sym("dq", 2), ca.SX.sym("u", 2), ca.SX.sym("mass")
angles = ca.vertcat(q[0], q[0] + q[1])
ends = [LENGTH * ca.vertcat(ca.cos(angle), ca.sin(angle)) for angle in ca.vertsplit(angles)]  # along each link, x and z
hand = ends[0] + ends[1]
energy = ca.SX(0)
for link, center in enumerate((ends[0] / 2, ends[0] + ends[1] / 2)):
    speed, turn = ca.jtimes(center, q, dq), ca.jtimes(angles[link], q, dq)
    energy += mass * (ca.sumsqr(speed) / 2 + INERTIA * turn**2 / 2 - GRAVITY * center[1])
momentum = ca.gradient(energy, dq)
M, h = ca.jacobian(momentum, dq), ca.jtimes(momentum, q, dq) - ca.gradient(energy, q)
arm = mechanical(q, dq, u, M, h, ca.SX.eye(2), parameters=[mass])


def reach(oracle: bool, seconds: float = 2.0) -> float:
    """The hand's greatest height on the true, light arm, m; `oracle` puts the true error in the QP."""
    tick = Tick(arm, [Clf(q - GOAL, eps=0.2), Barrier("shelf", SHELF - hand[1], poles=(15.0, 15.0))], solver="osqp")
    error, believed, true = model_error(tick.terms), tick.p(mass=BELIEVED), tick.p(mass=TRUE)
    motion = NumpyFunction.of("motion", {"x": arm.x, "u": u, "p": arm.p}, {"x_dot": arm.x_dot, "height": hand[1]})
    x, highest = np.array([-0.5, 0.3, 0.0, 0.0]), -1.0
    for _ in range(round(seconds / DT)):
        found = error(x, believed, true if oracle else believed)
        torque = tick.decide(x, believed, Estimates(found.alpha, found.beta, found.output_error)).u
        x[2:] += DT * motion(x, torque, true).x_dot[2:]
        x[:2] += DT * x[2:]
        highest = max(highest, float(motion(x, torque, true).height[0]))
    return highest


if __name__ == "__main__":
    for oracle in (False, True):
        height = reach(oracle)
        verdict = "stays below" if height < SHELF + 5e-4 else "HITS"
        print(f"{'true' if oracle else 'nominal'} rows: hand up to {height:.4f} m, {verdict} the shelf at {SHELF} m")
