"""A planar five-link biped as CasADi expressions, in stance/swing coordinates, all parameters being symbols.

With q = (x, z, pitch, stance hip, stance knee, swing hip, swing knee), rotations about +y, theta the links' inertial
parameters and every link's origin p, angle phi, mass moment c~ = R(phi) m c and dc~/dphi = c~',

    tau = sum over links  p_q' (m (p'' + g) + phi'' c~' - phi'^2 c~) + phi_q' (I phi'' + c~'' (p'' + g))

is the Newton-Euler equation projected on q; it is linear in theta and in q'', which gives M, bias forces and regressor.
The stance foot is held by its Jacobian J = (1, J_r): q'' = N z + n_0, N = (-J_r; 1), n_0 = (-J-dot q-dot; 0) and

    N' M N z = N' (B u - h - M n_0);

the ground's force is what the base's two slides lack.
Sources: Khalil and Dombre (2002), chapters 9 and 12; Featherstone, Rigid Body Dynamics Algorithms (2008), section 8.
"""

from collections.abc import Callable
from dataclasses import dataclass

import casadi as ca

from rl_cbf_clf_controller.generated.layout import COORDINATES, CORRECTION_POWERS, LINKS, MOTORS, POWERS

GRAVITY = ca.DM([0, 9.81])
SLIDES = 2  # of the base: the coordinates that the stance foot takes up


@dataclass(frozen=True)
class Link:
    """Origin (2,) and absolute angle of the joint that carries it, and its inertial parameters (4,)."""

    origin: ca.SX
    angle: ca.SX
    parameters: ca.SX


def rotated(vector: ca.SX, angle: ca.SX) -> ca.SX:
    """(x, z) turned about +y."""
    cos, sin = ca.cos(angle), ca.sin(angle)
    return ca.vertcat(cos * vector[0] + sin * vector[1], cos * vector[1] - sin * vector[0])


def quarter_turn(vector: ca.SX) -> ca.SX:
    """The derivative of a turned vector in its angle."""
    return ca.vertcat(vector[1], -vector[0])


def kinematics(q: ca.SX, links: ca.SX, legs: ca.SX) -> tuple[list[Link], list[ca.SX]]:
    """All links and the two feet (2,); `links` (20,) and `legs` (12,) as in `layout.ROBOT`."""
    bodies, feet = [Link(q[:2], q[2], links[:4])], []
    for leg in range(2):
        hip, knee, foot = (legs[6 * leg + 2 * i : 6 * leg + 2 * i + 2] for i in range(3))
        thigh_angle = q[2] + q[3 + 2 * leg]
        shin_angle = thigh_angle + q[4 + 2 * leg]
        thigh = q[:2] + rotated(hip, q[2])
        shin = thigh + rotated(knee, thigh_angle)
        first = 4 * (1 + 2 * leg)
        bodies.append(Link(thigh, thigh_angle, links[first : first + 4]))
        bodies.append(Link(shin, shin_angle, links[first + 4 : first + 8]))
        feet.append(shin + rotated(foot, shin_angle))
    return bodies, feet


def inverse_dynamics(bodies: list[Link], q: ca.SX, dq: ca.SX, ddq: ca.SX) -> ca.SX:
    """tau (7,): the generalised forces of a motion."""
    tau = ca.SX.zeros(COORDINATES)
    for link in bodies:
        mass, moment, inertia = link.parameters[0], rotated(link.parameters[1:3], link.angle), link.parameters[3]
        jacobian, turn = ca.jacobian(link.origin, q), ca.jacobian(link.angle, q)
        rate, turning = turn @ dq, turn @ ddq
        lifted = jacobian @ ddq + ca.jtimes(jacobian @ dq, q, dq) + GRAVITY
        force = mass * lifted + turning * quarter_turn(moment) - rate**2 * moment
        tau += jacobian.T @ force + turn.T * (inertia * turning + ca.dot(quarter_turn(moment), lifted))
    return tau


def pinned_dynamics(
    q: ca.SX, dq: ca.SX, links: ca.SX, legs: ca.SX, motor_gain: ca.SX, joint_damping: ca.SX
) -> list[ca.SX]:
    """Kinematics of feet and hip; acceleration and stance-foot force affine in the torque; as in `layout.PINNED`."""
    bodies, (stance, swing) = kinematics(q, links, legs)
    ddq = ca.SX.sym("ddq", COORDINATES)
    tau = inverse_dynamics(bodies, q, dq, ddq)
    mass = ca.jacobian(tau, ddq)
    bias_forces = ca.substitute(tau, ddq, ca.SX.zeros(COORDINATES))
    bias_forces[3:] += joint_damping * ca.diag(mass)[3:] * dq[3:]
    stance_jacobian, stance_bias = motion(stance, q, dq)
    relative_jacobian, relative_bias = motion(swing - stance, q, dq)

    free = ca.vertcat(-stance_jacobian[:, SLIDES:], ca.SX.eye(COORDINATES - SLIDES))
    held = ca.vertcat(-stance_bias, ca.SX.zeros(COORDINATES - SLIDES))
    torque_less = -free.T @ (bias_forces + mass @ held)
    right = ca.horzcat(ca.vertcat(ca.SX.zeros(1, MOTORS), motor_gain * ca.SX.eye(MOTORS)), torque_less)
    accelerations = free @ solved(free.T @ mass @ free, right)
    accelerations[:, MOTORS] += held
    forces = mass[:SLIDES, :] @ accelerations
    forces[:, MOTORS] += bias_forces[:SLIDES]
    return [
        swing - stance,
        relative_jacobian @ dq,
        relative_jacobian,
        relative_bias,
        q[:2] - stance,
        dq[:2] - stance_jacobian @ dq,
        accelerations[:, :MOTORS],
        accelerations[:, MOTORS],
        forces[:, :MOTORS],
        forces[:, MOTORS],
    ]


def motion(point: ca.SX, q: ca.SX, dq: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Jacobian J (2, 7) of a point and its J-dot q-dot (2,)."""
    jacobian = ca.jacobian(point, q)
    return jacobian, ca.jtimes(jacobian @ dq, q, dq)


def solved(matrix: ca.SX, right: ca.SX) -> ca.SX:
    """`matrix`^-1 `right` of a symmetric, positive definite matrix, by L D L'."""
    D, LT, order = ca.ldl(matrix, False)
    return ca.ldl_solve(right, D, LT, order)


def outputs(
    q: ca.SX,
    dq: ca.SX,
    gradient: ca.SX,
    phase_start: ca.SX,
    powers: ca.SX,
    fading: ca.SX,
    correction: ca.SX,
    correction_begin: ca.SX,
    correction_width: ca.SX,
    descent: ca.SX,
) -> list[ca.SX]:
    """Outputs and their derivatives, as in `virtual_constraints.py` and `step_outputs.py`; see `layout.OUTPUTS`."""
    phase, phase_rate = ca.dot(gradient, q) - phase_start, ca.dot(gradient, dq)
    path = beyond_ends(ca.reshape(powers, POWERS, MOTORS).T, phase, fading)
    since = (phase - correction_begin) / correction_width
    corrected = beyond_ends(ca.reshape(correction, CORRECTION_POWERS, MOTORS).T, since, fading)
    faded = [each / correction_width**order for order, each in enumerate(corrected)]
    lowered = [descent * each for each in gradual_line(phase - 1, fading)]
    value, slope, curvature = (sum(each) for each in zip(path, faded, lowered, strict=True))
    controlled = ca.horzcat(ca.SX.zeros(MOTORS, COORDINATES - MOTORS), ca.SX.eye(MOTORS))
    return [
        ca.horzcat(q[3:] - value, dq[3:] - slope * phase_rate).T,
        controlled - slope @ gradient.T,
        -curvature * phase_rate**2,
        phase,
        phase_rate,
    ]


def beyond_ends(coefficients: ca.SX, s: ca.SX, fading: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """Polynomials (m,) of s and two derivatives, continued outside [0, 1] as in `bezier.py`."""
    inside = ca.fmin(ca.fmax(s, 0), 1)
    at = ca.SX.sym("at")
    value = ca.mtimes(coefficients, ca.vertcat(*(at**k for k in range(coefficients.shape[1]))))
    first = ca.jacobian(value, at)
    value, first, second = (ca.substitute(x, at, inside) for x in (value, first, ca.jacobian(first, at)))
    beyond = s - inside
    left = ca.exp(-ca.fabs(beyond) / fading)
    turned = fading * (1 - left) * ca.sign(beyond)
    bent = fading * (ca.fabs(beyond) - ca.fabs(turned))
    return value + first * beyond + second * bent, first + second * turned, second * left


def gradual_line(x: ca.SX, width: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
    """A line of slope 1 that begins gradually at x = 0, and two derivatives; as in `step_outputs.py`."""
    after = ca.fmax(x, 0) / width
    left = ca.exp(-after)
    return width * (after - 2 + (after + 2) * left), 1 - (1 + after) * left, after * left / width


def motion_regressor(q: ca.SX, dq: ca.SX, ddq: ca.SX, theta: ca.SX, legs: ca.SX) -> list[ca.SX]:
    """Y, M and the feet's Jacobians of a robot with two like legs; as in `layout.REGRESSOR`."""
    torso, *leg = ca.vertsplit(theta, 4)
    bodies, feet = kinematics(q, ca.vertcat(torso, *leg, *leg), legs)
    tau = inverse_dynamics(bodies, q, dq, ddq)
    return [ca.jacobian(tau, theta), ca.jacobian(tau, ddq), ca.vertcat(*(ca.jacobian(foot, q) for foot in feet))]


def foot_velocity(q: ca.SX, dq: ca.SX, legs: ca.SX) -> list[ca.SX]:
    """The stance foot's velocity and its slope; as in `layout.FOOT_VELOCITY`."""
    _, (stance, _) = kinematics(q, ca.SX.zeros(4 * len(LINKS)), legs)
    velocity = ca.jacobian(stance, q) @ dq
    return [velocity, ca.jacobian(velocity, q[3:5])]


EXPRESSIONS: dict[str, Callable[..., list[ca.SX]]] = {
    "pinned_dynamics": pinned_dynamics,
    "outputs": outputs,
    "motion_regressor": motion_regressor,
    "foot_velocity": foot_velocity,
}
