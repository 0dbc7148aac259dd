"""The nominal robot as CasADi expressions, in stance/swing coordinates.

With the stance foot on the ground and q = (x, z, pitch, stance hip, stance knee, swing hip, swing knee):

    M(q) q'' + h(q, q') = B u + J_stance(q)' F,      J_stance q'' + J_stance' q' = 0.

x runs along the ground and z at right angles to it. On ground that rises by the slope, gravity is turned against x.
The expressions are those of the controller's generated code; masses and lengths are read from the URDF.
"""

from functools import cache

import casadi as ca
import numpy as np
from rabbit_description.state import Array
from rl_cbf_clf_controller.generated.expressions import inverse_dynamics, kinematics
from rl_cbf_clf_controller.generated_model import leg_lengths, link_parameters
from rl_cbf_clf_controller.nominal_model import NominalModel

GRAVITY = 9.81
PAYLOAD_HEIGHT = 0.24  # m above the hip: the torso's centre of mass


@cache
def nominal_parameters() -> tuple[Array, Array]:
    """Links (20,) and legs (12,) of the URDF, as in `generated.layout.ROBOT`."""
    model = NominalModel().model
    return link_parameters(model), leg_lengths(model)


def feet(q: ca.SX) -> tuple[ca.SX, ca.SX]:
    """Stance and swing foot (x, z), m."""
    links, legs = nominal_parameters()
    _, (stance, swing) = kinematics(q, ca.SX(links), ca.SX(legs))
    return stance, swing


@cache
def dynamics(payload: float = 0.0, slope: float = 0.0) -> tuple[ca.Function, ca.Function]:
    """`mass_matrix(q) -> (7, 7)` and `bias_forces(q, dq) -> (7,)` (Coriolis, centrifugal, gravity).

    `payload` kg, a point mass, rides on the torso; the ground rises by `slope` degrees.
    """
    q, dq, ddq = (ca.SX.sym(name, 7) for name in ("q", "dq", "ddq"))
    links, legs = nominal_parameters()
    links = links + np.append(payload * np.array([1, 0, PAYLOAD_HEIGHT, PAYLOAD_HEIGHT**2]), np.zeros(16))
    bodies, _ = kinematics(q, ca.SX(links), ca.SX(legs))
    tau = inverse_dynamics(bodies, q, dq, ddq)
    turned = ca.DM([GRAVITY * np.sin(np.radians(slope)), GRAVITY * (np.cos(np.radians(slope)) - 1), *[0.0] * 5])
    bias_forces = ca.substitute(tau, ddq, turned)  # weight under turned gravity is what this acceleration would take
    return ca.Function("mass_matrix", [q], [ca.jacobian(tau, ddq)]), ca.Function("bias_forces", [q, dq], [bias_forces])


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
