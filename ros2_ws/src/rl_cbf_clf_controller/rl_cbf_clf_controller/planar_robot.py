"""A planar robot that stands on one point foot, as CasADi expressions of q, q' and the robot's parameters.

With q = (x, z, pitch, joints), rotations about +y, theta the links' inertial parameters and every link's origin p,
angle phi, mass moment c~ = R(phi) m c and e = dc~/dphi,

    tau = sum over links  P^T (m (p'' + g) + phi'' e - phi'^2 c~) + Phi^T (I phi'' + e^T (p'' + g)),

P and Phi the Jacobians of p and phi in q, g upwards, is the Newton-Euler equation projected on q; it is linear in
theta and in q'', which gives M, bias forces and regressor. The stance foot is held by its Jacobian J = (1, J_r):
q'' = N z + n_0, N = (-J_r; 1), n_0 = (-J-dot q-dot; 0) and, ' for the transpose,

    N' M N z = N' (B u - h - M n_0);

the ground's force is what the base's two slides lack.
Sources: Khalil and Dombre (2002), chapters 9 and 12; Featherstone, Rigid Body Dynamics Algorithms (2008), section 8.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import casadi as ca
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.system import System, solved
from rabbit_description.planar_urdf import BASE, SLIDES

INERTIAL = ("m", "mc_x", "mc_z", "I_yy")  # parameters of a link
STILL = 0.02  # rad/s, below which dry friction fades, so that it has a value at rest


@dataclass(frozen=True)
class Structure:
    """Link 0 is the torso. `parents`: the link that each further one hangs on; `feet`: of the stance and swing foot."""

    parents: tuple[int, ...] = (0, 1, 0, 3)
    feet: tuple[int, int] = (2, 4)

    @property
    def motors(self) -> int:
        """One in every joint after the base."""
        return len(self.parents)

    @property
    def coordinates(self) -> int:
        return BASE + self.motors


RABBIT = Structure()  # torso, stance thigh and shin, swing thigh and shin


def robot_parameters(structure: Structure = RABBIT) -> dict[str, ca.SX]:
    """New symbols for all that distinguishes one such robot from another.

    `links` (n, 4): m, m c_x, m c_z, I_yy of each link in the frame of the joint that carries it, kg, kg m, kg m^2;
    `joints` (n - 1, 2), `feet` (2, 2): x, z in the frame of the link above, m; `motor_gain` (m,): the share of a torque
    that arrives; `joint_damping`, 1/s: of the force -d M_jj q_j'; `coulomb`, N m: dry friction of each joint;
    `gravity` (2,): of the ground's frame, upwards, m/s^2.
    """
    links = len(structure.parents) + 1
    shapes = {"links": (links, len(INERTIAL)), "joints": (links - 1, 2), "feet": (2, 2)}
    shapes |= {"motor_gain": (structure.motors, 1), "joint_damping": (1, 1), "coulomb": (1, 1), "gravity": (2, 1)}
    return {name: ca.SX.sym(name, *shape) for name, shape in shapes.items()}


@dataclass(frozen=True)
class Link:
    """Origin (2,) and absolute angle of the joint that carries it, and its inertial parameters (4,)."""

    origin: ca.SX
    angle: ca.SX
    parameters: ca.SX


class PinnedRobot:
    """Expressions of a robot with the symbols `q`, `dq` (n,), `u` (m,) and its `parameters` by name."""

    def __init__(self, structure: Structure = RABBIT, parameters: Mapping[str, ca.SX] | None = None) -> None:
        n, m = structure.coordinates, structure.motors
        self.structure = structure
        self.q, self.dq, self.u = ca.SX.sym("q", n), ca.SX.sym("dq", n), ca.SX.sym("u", m)
        self.parameters = dict(parameters or robot_parameters(structure))

    def system(self, further: Mapping[str, ca.SX], rates: Mapping[str, ca.SX]) -> System:
        """The system with the stance foot held; its parameters: the robot's and `further` ones, some with `rates`."""
        x_dot = ca.vertcat(self.dq, self.acceleration(self.u))
        return System(ca.vertcat(self.q, self.dq), self.u, x_dot, {**self.parameters, **further}, rates)

    @cached_property
    def links(self) -> list[Link]:
        """All of them."""
        p = self.parameters
        links = [Link(self.q[:SLIDES], self.q[SLIDES], p["links"][0, :].T)]
        for i, parent in enumerate(self.structure.parents):
            above = links[parent]
            origin = above.origin + rotated(p["joints"][i, :].T, above.angle)
            links.append(Link(origin, above.angle + self.q[BASE + i], p["links"][i + 1, :].T))
        return links

    @cached_property
    def feet(self) -> tuple[ca.SX, ca.SX]:
        """Stance and swing foot (2,), world frame, m."""
        points = self.parameters["feet"]
        ends = [self.links[link] for link in self.structure.feet]
        stance, swing = (end.origin + rotated(points[i, :].T, end.angle) for i, end in enumerate(ends))
        return stance, swing

    @property
    def swing(self) -> ca.SX:
        """The swing foot from the stance foot (2,), m."""
        return self.feet[1] - self.feet[0]

    @property
    def hip(self) -> ca.SX:
        """The base from the stance foot (2,), m."""
        return self.q[:SLIDES] - self.feet[0]

    def rate(self, expression: ca.SX) -> ca.SX:
        """The time derivative of an expression of q."""
        return ca.jtimes(expression, self.q, self.dq)

    def inverse_dynamics(self, ddq: ca.SX) -> ca.SX:
        """tau (n,): the generalised forces of a motion."""
        tau = ca.SX.zeros(self.structure.coordinates)
        for link in self.links:
            mass, moment, inertia = link.parameters[0], rotated(link.parameters[1:3], link.angle), link.parameters[3]
            jacobian, turn = ca.jacobian(link.origin, self.q), ca.jacobian(link.angle, self.q)
            rate, turning = turn @ self.dq, turn @ ddq
            lifted = jacobian @ ddq + self.rate(jacobian @ self.dq) + self.parameters["gravity"]
            force = mass * lifted + turning * quarter_turn(moment) - rate**2 * moment
            tau += jacobian.T @ force + turn.T * (inertia * turning + ca.dot(quarter_turn(moment), lifted))
        return tau

    @cached_property
    def mass_and_bias(self) -> tuple[ca.SX, ca.SX]:
        """M (n, n), and the bias forces h (n,) without what the joints' friction adds."""
        ddq = ca.SX.sym("ddq", self.structure.coordinates)
        tau = self.inverse_dynamics(ddq)
        return ca.jacobian(tau, ddq), ca.substitute(tau, ddq, ca.SX.zeros(ddq.shape))

    @cached_property
    def _pinned(self) -> tuple[Affine, Affine]:
        p, m = self.parameters, self.structure.motors
        mass, bias = self.mass_and_bias
        friction = p["joint_damping"] * ca.diag(mass)[BASE:] * self.dq[BASE:]
        bias = bias + ca.vertcat(ca.SX.zeros(BASE), friction + p["coulomb"] * ca.tanh(self.dq[BASE:] / STILL))
        jacobian = ca.jacobian(self.feet[0], self.q)
        free = ca.vertcat(-jacobian[:, SLIDES:], ca.SX.eye(m + BASE - SLIDES))
        held = ca.vertcat(-self.rate(jacobian @ self.dq), ca.SX.zeros(m + BASE - SLIDES))
        torques = ca.vertcat(ca.SX.zeros(BASE - SLIDES, m), ca.diag(p["motor_gain"]))
        right = ca.horzcat(torques, -free.T @ (bias + mass @ held))
        accelerations = free @ solved(free.T @ mass @ free, right)
        acceleration = Affine(accelerations[:, :m], accelerations[:, m] + held)
        return acceleration, Affine(mass[:SLIDES, :], bias[:SLIDES]).after(acceleration)

    @property
    def acceleration(self) -> Affine:
        """q'' (n,), affine in u."""
        return self._pinned[0]

    @property
    def force(self) -> Affine:
        """The ground's force (F_T, F_N) on the stance foot, N, affine in u."""
        return self._pinned[1]


def rotated(vector: ca.SX, angle: ca.SX) -> ca.SX:
    """(x, z) turned about +y."""
    cos, sin = ca.cos(angle), ca.sin(angle)
    return ca.vertcat(cos * vector[0] + sin * vector[1], cos * vector[1] - sin * vector[0])


def quarter_turn(vector: ca.SX) -> ca.SX:
    """The derivative of a turned vector in its angle."""
    return ca.vertcat(vector[1], -vector[0])
