"""Random states of a walk; the robot in symbols behind the interface of its peer by pinocchio."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp.affine import Affine
from cbf_clf_qp.functions import NumpyFunction, packed
from rabbit_description.state import Array
from rl_cbf_clf_controller.planar_robot import PinnedRobot
from rl_cbf_clf_controller.robot_numbers import read_robot

try:
    from rabbit_gait_design.pinocchio_model import Kinematics, PinnedDynamics, PinocchioModel
except ModuleNotFoundError:  # without the studies, what is compared with their model is skipped
    PinocchioModel = None


@pytest.fixture(params=range(5))
def state(request: pytest.FixtureRequest) -> tuple[Array, Array]:
    """One of five random states `(q_s, dq_s)` as in a walk, knees flexed."""
    rng = np.random.default_rng(request.param)
    center = np.array([0.0, 0.75, 0.1, -0.3, 0.5, -0.3, 0.6])
    return center + rng.uniform(-0.3, 0.3, 7), rng.uniform(-3, 3, 7)


class SymbolicModel:
    """`planar_robot.py` with the methods of `PinocchioModel`."""

    def __init__(self, urdf: str | None = None, motor_gain: float = 1.0, joint_damping: float = 0.0) -> None:
        read = read_robot(urdf)
        self.numbers = replace(read, motor_gain=motor_gain * read.motor_gain, joint_damping=joint_damping)
        robot = PinnedRobot(read.structure)
        swing_rate = robot.rate(robot.swing)
        inputs = {"q": robot.q, "dq": robot.dq, "robot": packed(robot.parameters)}
        found = {"swing": robot.swing, "swing_rate": swing_rate, "jacobian": ca.jacobian(robot.swing, robot.q)}
        found |= {"bias": robot.rate(swing_rate), "hip": robot.hip, "hip_rate": robot.rate(robot.hip)}
        found |= {"acceleration_a": robot.acceleration.a, "acceleration_b": robot.acceleration.b}
        found |= {"force_a": robot.force.a, "force_b": robot.force.b, "mass": robot.mass_and_bias[0]}
        self._function = NumpyFunction.of("model", inputs, found)

    def update(self, q_s: Array, dq_s: Array) -> Kinematics:
        self._at = found = self._function(q_s, dq_s, self.numbers.row)
        return Kinematics(found.swing, found.swing_rate, found.jacobian, found.bias, found.hip, found.hip_rate)

    def pinned(self) -> PinnedDynamics:
        found = self._at
        acceleration, force = (found.acceleration_a, found.acceleration_b), (found.force_a, found.force_b)
        return PinnedDynamics(Affine(*acceleration), Affine(*force))

    def mass_matrix(self) -> Array:
        return self._at.mass


@pytest.fixture(params=[SymbolicModel, PinocchioModel])
def make_model(request: pytest.FixtureRequest) -> type[SymbolicModel | PinocchioModel]:
    """The class of the robot in symbols, and of its peer."""
    return request.param


@pytest.fixture
def models() -> tuple[type[SymbolicModel], type[PinocchioModel]]:
    """Both of them."""
    return SymbolicModel, PinocchioModel
