"""One instant of a gait whose outputs are identically zero, as CasADi functions.

With y = 0 the configuration is a function q(s) of the phase alone. With sigma = s'^2 / 2 and w = s'' = d sigma / d s,

    q' = q_s s',    q'' = 2 sigma q_ss + w q_s,

so (w, u, F) follow from the seven equations of motion, and the walk is one scalar equation d sigma / d s = w(s, sigma):
the hybrid zero dynamics (Westervelt, Grizzle, Koditschek 2003).
"""

from functools import cache
from math import comb

import casadi as ca
from cbf_clf_qp.constraints import ecbf_gains
from cbf_clf_qp.system import System
from rabbit_description.state import SWAP_STATE
from rl_cbf_clf_controller.stone_barriers import stone_barriers

from rabbit_gait_design import symbolic_robot

DEGREE = 5
SWAP = SWAP_STATE.tolist()  # stance <-> swing


def bezier(coeffs: ca.SX, s: ca.SX) -> ca.SX:
    """Bézier curve, rows of `coeffs` (n, DEGREE + 1) at `s`, shape (n,)."""
    basis = [comb(DEGREE, k) * s**k * (1 - s) ** (DEGREE - k) for k in range(DEGREE + 1)]
    return coeffs @ ca.vertcat(*basis)


def configuration(coeffs: ca.SX, phase_range: ca.SX, s: ca.SX) -> ca.SX:
    """q(s), shape (7,), stance foot at the origin; `phase_range` = (phase angle at s = 0, at s = 1)."""
    joints = bezier(coeffs, s)
    phase_angle = phase_range[0] + s * (phase_range[1] - phase_range[0])
    pitch = phase_angle - joints[0] - joints[1] / 2
    from_hip, _ = symbolic_robot.feet()(ca.vertcat(0, 0, pitch, joints))
    return ca.vertcat(-from_hip, pitch, joints)


@cache
def path() -> ca.Function:
    """`(coeffs, phase_range, s) -> q, q_s, q_ss`."""
    coeffs, phase_range, s = ca.SX.sym("coeffs", 4, DEGREE + 1), ca.SX.sym("phase_range", 2), ca.SX.sym("s")
    q = configuration(coeffs, phase_range, s)
    q_s = ca.jacobian(q, s)
    return ca.Function("path", [coeffs, phase_range, s], [q, q_s, ca.jacobian(q_s, s)])


@cache
def dynamics_residual(slope: float = 0.0) -> ca.Function:
    """`(coeffs, phase_range, s, sigma, w, u (4,), force (2,)) -> residual (7,)` of the equation of motion, N, N m.

    On ground that rises by `slope` degrees.
    """
    coeffs, phase_range, s = ca.SX.sym("coeffs", 4, DEGREE + 1), ca.SX.sym("phase_range", 2), ca.SX.sym("s")
    sigma, w, u, force = ca.SX.sym("sigma"), ca.SX.sym("w"), ca.SX.sym("u", 4), ca.SX.sym("force", 2)
    q, q_s, q_ss = path()(coeffs, phase_range, s)
    dq, ddq = q_s * ca.sqrt(2 * sigma), 2 * sigma * q_ss + w * q_s
    mass_matrix, bias_forces = symbolic_robot.dynamics(slope)
    contact = symbolic_robot.foot_motion()(q=q, dq=dq, ddq=ddq)
    generalised = ca.vertcat(ca.SX.zeros(3), u) + contact["J_stance"].T @ force
    residual = mass_matrix(q) @ ddq + bias_forces(q, dq) - generalised
    return ca.Function("dynamics_residual", [coeffs, phase_range, s, sigma, w, u, force], [residual])


@cache
def swing_foot() -> ca.Function:
    """`(coeffs, phase_range, s, sigma, w) -> position, velocity, acceleration` of the swing foot, each (2,)."""
    coeffs, phase_range, s = ca.SX.sym("coeffs", 4, DEGREE + 1), ca.SX.sym("phase_range", 2), ca.SX.sym("s")
    sigma, w = ca.SX.sym("sigma"), ca.SX.sym("w")
    q, q_s, q_ss = path()(coeffs, phase_range, s)
    motion = symbolic_robot.foot_motion()(q=q, dq=q_s * ca.sqrt(2 * sigma), ddq=2 * sigma * q_ss + w * q_s)
    outputs = [motion["swing"], motion["v_swing"], motion["a_swing"]]
    return ca.Function("swing_foot", [coeffs, phase_range, s, sigma, w], outputs)


def barrier_conditions(l_min: float, l_max: float, R1: float, R2: float, poles: tuple[float, float]) -> ca.Function:
    """`(foot, velocity, acceleration) -> (2,)`: both ECBF expressions, which must not be negative, m/s^2."""
    foot, velocity, acceleration = (ca.SX.sym(name, 2) for name in ("foot", "velocity", "acceleration"))
    motion = System(ca.vertcat(foot, velocity), acceleration, ca.vertcat(velocity, acceleration))
    rows = []
    for barrier in stone_barriers(foot, l_min, l_max, 0.0, R1, R2):
        value, rate, curvature = motion.derivatives("barrier", barrier, 2)
        proportional, damping = ecbf_gains(poles)
        rows.append(curvature + damping * rate + proportional * value)
    return ca.Function("barrier_conditions", [foot, velocity, acceleration], [ca.vertcat(*rows)])
