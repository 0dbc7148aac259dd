"""Accelerations and ground force of a robot with one foot pinned, from the dynamics of the plant `rigid`."""

import numpy as np
import pinocchio
from rabbit_description.state import Array, Leg
from rabbit_sim.pinned_dynamics import PinnedDynamics

PLANE = [0, 2]


def accelerations(dynamics: PinnedDynamics, q: Array, dq: Array, torque: Array, stance: Leg) -> tuple[Array, Array]:
    """`ddq` (n,) and the ground force (2,) on the stance foot, x and z, N, under joint torques (n - 3,), N m."""
    chain = dynamics.chains[stance]
    ddq = np.zeros(dynamics.coordinates)
    ddq[2:] = chain.out @ dynamics.in_chain(stance, torque)(chain.into @ q[2:], chain.into @ dq[2:])
    ddq[:2] = -dynamics.feet.jacobian(q, stance) @ ddq - drift(dynamics, q, dq, stance)
    return ddq, pinocchio.rnea(dynamics.model, dynamics.data, q, dq, ddq)[:2]


def drift(dynamics: PinnedDynamics, q: Array, dq: Array, leg: Leg) -> Array:
    """dJ/dt dq: the foot's acceleration (x, z) at constant rates, shape (2,), m/s^2."""
    pinocchio.forwardKinematics(dynamics.model, dynamics.data, q, dq, np.zeros_like(dq))
    frame, world = dynamics.model.getFrameId(dynamics.feet.links[leg]), pinocchio.LOCAL_WORLD_ALIGNED
    return pinocchio.getFrameClassicalAcceleration(dynamics.model, dynamics.data, frame, world).linear[PLANE]
