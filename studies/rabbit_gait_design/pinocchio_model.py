"""The robot by pinocchio: the peer of `planar_robot.py`, for tests and for what checks a gait independently.

With the stance foot held, (q-ddot, F) solve, for a torque u at the joints after the base's three coordinates,

    M(q) q-ddot + bias_forces(q, q-dot) = input_map u + J' F
    J q-ddot + J-dot q-dot = 0,

F = (F_T, F_N) being the ground's force on the stance foot and J its Jacobian. Both are affine in u. Coordinates are
relabelled to stance/swing, so the model's left leg is always the stance leg. Impact: inelastic, the swing foot stays.
"""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from cbf_clf_qp.affine import Affine
from rabbit_description import URDF_PATH
from rabbit_description.state import Array
from rl_cbf_clf_controller.robot_numbers import PLANE


def input_map(coordinates: int) -> Array:
    """B (n, n - 3): every coordinate after the base's three has a motor."""
    return np.eye(coordinates)[:, 3:]


@dataclass(frozen=True)
class Kinematics:
    """Swing foot from the stance foot and hip (the base) from the stance foot, world frame; m, m/s, m/s^2.

    `swing`, `swing_rate`, `hip`, `hip_rate` (2,); `swing_jacobian` (2, n); `swing_bias` (2,) its J-dot q-dot.
    """

    swing: Array
    swing_rate: Array
    swing_jacobian: Array
    swing_bias: Array
    hip: Array
    hip_rate: Array


@dataclass(frozen=True)
class PinnedDynamics:
    """`acceleration` (n) and stance-foot `force` (F_T, F_N), both affine in the torque u (m,), stance/swing order."""

    acceleration: Affine
    force: Affine


class PinocchioModel:
    """Pinned-foot dynamics of a planar URDF robot with n coordinates, m = n - 3 motors; RABBIT's if none is given.

    `feet`: the links of the left and the right foot. `motor_gain` and `joint_damping` (generalised force -d M_jj dq_j,
    1/s) are 1 and 0 in a nominal model; the oracle's model carries the plant's.
    """

    def __init__(
        self,
        urdf: str | None = None,
        motor_gain: float = 1.0,
        joint_damping: float = 0.0,
        feet: tuple[str, str] = ("left_foot", "right_foot"),
    ) -> None:
        self.model = pin.buildModelFromXML(urdf or URDF_PATH.read_text(encoding="utf-8"))
        self.data = self.model.createData()
        self._stance, self._swing = (self.model.getFrameId(foot) for foot in feet)
        self._no_acceleration = np.zeros(self.model.nv)
        self._input_map = input_map(self.model.nv)
        self.motor_gain, self.joint_damping = motor_gain, joint_damping

    def update(self, q_s: Array, dq_s: Array) -> Kinematics:
        """Compute all terms at a state `q_s`, `dq_s` (n,), stance/swing order, and return the feet's kinematics."""
        model, data = self.model, self.data
        pin.computeAllTerms(model, data, q_s, dq_s)
        pin.forwardKinematics(model, data, q_s, dq_s, self._no_acceleration)
        pin.updateFramePlacements(model, data)
        self._jacobian, self._bias = self._point(self._stance)
        swing_jacobian, swing_bias = self._point(self._swing)
        self._dq_s = dq_s
        stance, swing = (data.oMf[frame].translation[PLANE] for frame in (self._stance, self._swing))
        relative_jacobian = swing_jacobian - self._jacobian
        return Kinematics(
            swing=swing - stance,
            swing_rate=relative_jacobian @ dq_s,
            swing_jacobian=relative_jacobian,
            swing_bias=swing_bias - self._bias,
            hip=q_s[:2] - stance,
            hip_rate=dq_s[:2] - self._jacobian @ dq_s,
        )

    def pinned(self) -> PinnedDynamics:
        """Acceleration and contact force at the state of the last `update`."""
        n, m = self._input_map.shape
        damping = self.joint_damping * self._input_map.sum(axis=1) * np.diag(self.data.M) * self._dq_s
        mass, bias_forces = self.mass_matrix(), self.data.nle + damping
        kkt = np.zeros((n + 2, n + 2))
        kkt[:n, :n], kkt[:n, n:], kkt[n:, :n] = mass, -self._jacobian.T, self._jacobian
        right = np.zeros((n + 2, m + 1))
        right[:n, :m], right[:n, m], right[n:, m] = self.motor_gain * self._input_map, -bias_forces, -self._bias
        solution = np.linalg.solve(kkt, right)
        return PinnedDynamics(
            acceleration=Affine(solution[:n, :m], solution[:n, m]), force=Affine(solution[n:, :m], solution[n:, m])
        )

    def mass_matrix(self) -> Array:
        """M (n, n) at the state of the last `update`."""
        return symmetric(self.data.M)

    def impact(self, q_s: Array, dq_s: Array) -> tuple[Array, Array]:
        """Post-impact rates (n,) before relabelling and the impulse (2,), N s, if the swing foot lands at `q_s`."""
        self.update(q_s, dq_s)
        jacobian, _ = self._point(self._swing)
        mass = self.mass_matrix()
        kkt = np.block([[mass, -jacobian.T], [jacobian, np.zeros((2, 2))]])
        solution = np.linalg.solve(kkt, np.concatenate([mass @ dq_s, np.zeros(2)]))
        return solution[:-2], solution[-2:]

    def _point(self, frame: int) -> tuple[Array, Array]:
        """Planar Jacobian (2, n) of a frame's origin and its J-dot q-dot (2,)."""
        world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        jacobian = pin.getFrameJacobian(self.model, self.data, frame, world)[PLANE]
        bias = pin.getFrameClassicalAcceleration(self.model, self.data, frame, world).linear[PLANE]
        return jacobian, bias


def symmetric(upper: Array) -> Array:
    """The whole of a matrix of which pinocchio fills the upper triangle."""
    upper = np.triu(upper)
    return upper + np.triu(upper, 1).T
