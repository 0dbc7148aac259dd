"""Exact alpha and beta from the plant's own parameters: for tests and upper bounds, never for training.

A second model carries the plant's perturbed parameters (`cbf_clf_qp.model_error`). In the first approach alpha and beta
are the input that makes y-ddot = mu: I + alpha = LgLfh_nominal LgLfh_true^-1, beta = LgLfh_nominal (u_true* -
u_nominal*).

With motors of gains g and dry friction c in each joint, a commanded torque u acts as

    g u - c sign(joint rate).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from math import cos, radians, sin

import numpy as np
import pinocchio as pin
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.estimates import Estimates
from cbf_clf_qp.io_linearization import precontrol
from cbf_clf_qp.model_error import ModelError
from cbf_clf_qp.tick import Terms
from rabbit_description.state import SWAP_TORQUE, Array

from rl_cbf_clf_controller.generated_model import GeneratedModel, generated_if_built
from rl_cbf_clf_controller.nominal_model import NominalModel
from rl_cbf_clf_controller.pinned_robot import PinnedDynamics
from rl_cbf_clf_controller.policy import Policy
from rl_cbf_clf_controller.scene import Scene

GRAVITY = 9.81  # m/s^2
STILL = 0.02  # rad/s, below which dry friction fades, so that it has a value at rest


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

    def model(self, stance: int) -> GeneratedModel | NominalModel:
        """The robot with its left (0) or its right leg (1) as the stance leg."""
        robot = NominalModel(self.urdf, self.motor_gain, self.joint_damping)
        if stance:
            exchange_legs(robot.model)
        if self.slope:
            rise = radians(self.slope)
            robot.model.gravity.linear = np.array([-GRAVITY * sin(rise), 0.0, -GRAVITY * cos(rise)])
        return generated_if_built(robot)


def exchange_legs(model: pin.Model) -> None:
    """Give each leg the masses and inertias of the other."""
    for name in model.names:
        if name.startswith("left_"):
            left, right = model.getJointId(name), model.getJointId(name.replace("left_", "right_"))
            own, other = model.inertias[left].copy(), model.inertias[right].copy()
            model.inertias[left], model.inertias[right] = other, own


class OraclePolicy(Policy):
    """The true errors of a `plant`; with `io` those of the first approach."""

    version = "oracle"
    adaptation = "none"  # it leaves nothing to find

    def __init__(self, plant: TruePlant, io: bool = False) -> None:
        self._plant = plant
        self._models = (plant.model(0), plant.model(1))
        self._io = io
        self._error = ModelError()

    def estimate(self, terms: Terms[Scene], before: Estimates) -> Estimates:
        """Exact estimates at this tick."""
        scene = terms.scene
        model = self._models[int(scene.stance)]
        model.update(scene.q_s, scene.dq_s)
        dynamics = self._driven(model.pinned(), scene)
        if self._io:
            true_control = precontrol(scene.outputs.second_derivative(dynamics.acceleration))
            error = terms.precontrol.inverse().after(true_control)
            return Estimates(error.a - np.eye(len(error.b)), error.b)
        return self._error(terms, dynamics)

    def _driven(self, dynamics: PinnedDynamics, scene: Scene) -> PinnedDynamics:
        """Over the commanded torque, with each motor's gain and dry friction."""
        plant = self._plant
        if not plant.motor_gains and not plant.coulomb:
            return dynamics
        gains = np.array(plant.motor_gains or (1.0,) * 4)
        gains = gains[SWAP_TORQUE] if scene.stance else gains
        friction = plant.coulomb * np.tanh(scene.dq_s[3:] / STILL)

        def driven(of_torque: Affine) -> Affine:
            a: Array = of_torque.a
            return Affine(a * gains, of_torque.b - a @ friction)

        return PinnedDynamics(driven(dynamics.acceleration), driven(dynamics.force))
