"""The first state of an episode: the gait's post-impact state, noise, and a stance foot at rest on the ground.

The noise moves the five angles and their rates. The base follows: its position puts the left, stance foot's centre at
(0, 0), its velocity that foot at rest, in the true kinematics. A swing foot that the noise has put below the ground is
raised to it by its knee.
"""

from math import acos, atan, hypot

import numpy as np
from rabbit_description.gait import Gaits
from rabbit_description.planar_urdf import SLIDES
from rabbit_description.state import DOF, Array, Leg

from rabbit_sim.kinematics import LegShape, RabbitFeet
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.robot_urdf import leg_shape

SWING_KNEE = 6  # in q, while the left leg stands


def initial_state(parameters: SimulationParameters, gait: Gaits, rng: np.random.Generator) -> tuple[Array, Array]:
    """`(q, dq)`, each of shape (7,), left stance."""
    q, dq = gait.x_start
    spread = parameters.x0_spread
    q[SLIDES:] += spread * parameters.x0_position_std * rng.standard_normal(DOF - SLIDES)
    dq[SLIDES:] *= 1 + spread * parameters.x0_velocity_std * rng.standard_normal(DOF - SLIDES)
    return project(q, dq, RabbitFeet(leg_shape(parameters)))


def project(q: Array, dq: Array, feet: RabbitFeet) -> tuple[Array, Array]:
    """The nearest base to hold the left foot at rest at (0, 0); the right foot not below it. Copies, shape (7,)."""
    q, dq = q.copy(), dq.copy()
    q[:2] -= feet.positions(q)[Leg.LEFT]
    depth = -float(feet.positions(q)[Leg.RIGHT, 1])
    if depth > 1e-12:  # rounding apart
        _raise_swing_foot(q, feet.shape, depth)
    dq[:2] -= feet.jacobian(q, Leg.LEFT) @ dq
    return q, dq


def _raise_swing_foot(q: Array, shape: LegShape, depth: float) -> None:
    """Flex the right knee until its foot is higher by `depth`, m, or as high as the knee can bring it."""
    # the shin hangs L sqrt(1 + bend^2) cos(a - atan(bend)) below the knee at the angle a
    length, lean = shape.shin * hypot(1.0, shape.shin_bend), atan(shape.shin_bend)
    upper = float(q[2] + q[5])
    angle = upper + float(q[SWING_KNEE]) - lean
    reach = length * np.cos(angle) - depth
    q[SWING_KNEE] = acos(max(-1.0, min(1.0, reach / length))) + lean - upper
