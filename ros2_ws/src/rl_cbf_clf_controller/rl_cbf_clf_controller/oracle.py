"""Exact alpha and beta from the plant's parameters: for tests, upper bounds and the rival that it teaches.

The plant's numbers take the place of the nominal robot's. In the first approach alpha and beta are the input that makes
y-ddot = mu: where the quantities' errors say y-ddot = (I + A) mu + b, that is alpha = (I + A)^-1 - I,
beta = -(I + A)^-1 b.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import cos, radians, sin

import numpy as np
from cbf_clf_qp.estimates import Estimates

from rl_cbf_clf_controller.policy import Policy
from rl_cbf_clf_controller.robot_numbers import GRAVITY, RobotNumbers, read_robot
from rl_cbf_clf_controller.scene import Scene


@dataclass(frozen=True)
class TruePlant:
    """What the oracle knows: the true robot, its motors and joints, and the `slope` that it stands on, degrees.

    `motor_gain` is of all motors, `motor_gains` (4,) of each one: left hip and knee, right hip and knee;
    `joint_damping` in 1/s, `coulomb` in N m. It does not know what is no part of a pinned rigid robot: ground that
    gives, pushes, elastic gears, backlash, what swings, and delays.
    """

    urdf: str
    motor_gain: float = 1.0
    joint_damping: float = 0.0
    motor_gains: Sequence[float] = ()
    coulomb: float = 0.0
    slope: float = 0.0

    def robot(self, stance: int) -> RobotNumbers:
        """The robot with its left (0) or its right leg (1) as the stance leg."""
        read, rise = read_robot(self.urdf), radians(self.slope)
        gains = self.motor_gain * np.array(self.motor_gains or np.ones(read.structure.motors))
        gravity = np.linalg.norm(GRAVITY) * np.array([sin(rise), cos(rise)])
        robot = replace(read, motor_gain=gains, gravity=gravity, joint_damping=self.joint_damping, coulomb=self.coulomb)
        return robot.mirrored() if stance else robot


class OraclePolicy(Policy):
    """The true errors of a `plant`; with `io` those of the first approach."""

    version = "oracle"
    adaptation = "none"  # it leaves nothing to find

    def __init__(self, plant: TruePlant, io: bool = False) -> None:
        self._robots = [plant.robot(stance).row for stance in (0, 1)]
        self._io = io

    def estimate(self, scene: Scene, before: Estimates) -> Estimates:
        error = scene.error_of(self._robots[scene.stance])
        if not self._io:
            return error
        identity = np.eye(len(error.beta))
        inverse = np.linalg.inv(identity + error.alpha)
        return Estimates(inverse - identity, -inverse @ error.beta)
