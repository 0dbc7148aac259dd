"""The nominal robot as CasADi expressions, in stance/swing coordinates.

With the stance foot on the ground and q = (x, z, pitch, stance hip, stance knee, swing hip, swing knee):

    M(q) q'' + h(q, q') = B u + J_stance(q)' F,      J_stance q'' + J_stance' q' = 0.

Built from the links' centres of mass, not from pinocchio, so that each checks the other (the wheel of pinocchio has no
CasADi interface); masses and lengths are read from the same URDF.
"""

from dataclasses import dataclass
from functools import cache

import casadi as ca
import pinocchio as pin
from rabbit_description import URDF_PATH

GRAVITY = 9.81
PAYLOAD_HEIGHT = 0.24  # m above the hip: the torso's centre of mass


@dataclass(frozen=True)
class Link:
    """Mass (kg), inertia about the centre of mass (kg m^2), signed height of that centre above the upper joint (m)."""

    mass: float
    inertia: float
    com: float


@cache
def nominal_links() -> tuple[Link, Link, Link, float, float]:
    """Torso, thigh and shin, then the thigh's and the shin's lengths, from the URDF."""
    model = pin.buildModelFromUrdf(str(URDF_PATH))

    def link(joint: str) -> Link:
        body = model.inertias[model.getJointId(joint)]
        return Link(body.mass, body.inertia[1, 1], body.lever[2])

    thigh_length = -model.jointPlacements[model.getJointId("left_knee")].translation[2]
    shin_length = -model.frames[model.getFrameId("left_foot")].placement.translation[2]
    return link("base_pitch"), link("left_hip"), link("left_knee"), thigh_length, shin_length


def up(angle: ca.SX) -> ca.SX:
    """Unit vector (x, z) of a link turned by `angle` about +y."""
    return ca.vertcat(ca.sin(angle), ca.cos(angle))


def feet(q: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Stance and swing foot (x, z), m."""
    *_, thigh_length, shin_length = nominal_links()
    stance, swing = (q[:2] - thigh_length * up(q[2] + q[i]) - shin_length * up(q[2] + q[i] + q[i + 1]) for i in (3, 5))
    return stance, swing


def bodies(q: ca.SX, payload: float) -> list[tuple[Link, ca.SX, ca.SX]]:
    """Each link with its centre of mass (x, z) and its absolute angle; `payload` kg rides on the torso."""
    torso, thigh, shin, thigh_length, _ = nominal_links()
    load = Link(payload, 0.0, PAYLOAD_HEIGHT)
    result = [(link, q[:2] + link.com * up(q[2]), q[2]) for link in (torso, load)]
    for i in (3, 5):
        thigh_angle, shin_angle = q[2] + q[i], q[2] + q[i] + q[i + 1]
        knee = q[:2] - thigh_length * up(thigh_angle)
        result.append((thigh, q[:2] + thigh.com * up(thigh_angle), thigh_angle))
        result.append((shin, knee + shin.com * up(shin_angle), shin_angle))
    return result


@cache
def dynamics(payload: float = 0.0) -> tuple[ca.Function, ca.Function]:
    """`mass_matrix(q) -> (7, 7)` and `bias_forces(q, dq) -> (7,)` (Coriolis, centrifugal, gravity)."""
    q, dq = ca.SX.sym("q", 7), ca.SX.sym("dq", 7)
    mass, bias = ca.SX.zeros(7, 7), ca.SX.zeros(7)
    for link, centre, angle in bodies(q, payload):
        jacobian, turn = ca.jacobian(centre, q), ca.jacobian(angle, q)
        mass += link.mass * jacobian.T @ jacobian + link.inertia * turn.T @ turn
        convective = ca.jtimes(jacobian @ dq, q, dq)
        bias += link.mass * jacobian.T @ (convective + ca.vertcat(0, GRAVITY))
    return ca.Function("mass_matrix", [q], [mass]), ca.Function("bias_forces", [q, dq], [bias])


@cache
def foot_motion() -> ca.Function:
    """`(q, dq, ddq) -> stance, swing position, velocity, acceleration, stance Jacobian, swing Jacobian`."""
    q, dq, ddq = (ca.SX.sym(name, 7) for name in ("q", "dq", "ddq"))
    stance, swing = feet(q)
    outputs = [stance, swing]
    for position in (stance, swing):
        velocity = ca.jtimes(position, q, dq)
        outputs += [velocity, ca.jtimes(velocity, q, dq) + ca.jtimes(position, q, ddq)]
    outputs += [ca.jacobian(stance, q), ca.jacobian(swing, q)]
    names = ["stance", "swing", "v_stance", "a_stance", "v_swing", "a_swing", "J_stance", "J_swing"]
    return ca.Function("foot_motion", [q, dq, ddq], outputs, ["q", "dq", "ddq"], names)
