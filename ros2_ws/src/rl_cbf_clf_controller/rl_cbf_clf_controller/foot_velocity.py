"""The velocity of the stance foot, and how it changes with the angles of the stance leg."""

import numpy as np
import pinocchio as pin
from rabbit_description.state import Array

from rl_cbf_clf_controller.nominal_model import PLANE

QUARTER_TURN = np.array([[0.0, 1.0], [-1.0, 0.0]])  # about +y, of (x, z)


class FootVelocity:
    """Of a model's left foot, computed by pinocchio."""

    def __init__(self, model: pin.Model) -> None:
        self._model, self._data = model, model.createData()
        self._stance = model.getFrameId("left_foot")
        self._joints = [model.getJointId(name) for name in ("left_hip", "left_knee")]

    def __call__(self, q_s: Array, dq_s: Array) -> tuple[Array, Array]:
        """Velocity (2,), m/s, world frame, and its slope (2, 2) over the stance leg's hip and knee angle."""
        model, data = self._model, self._data
        pin.forwardKinematics(model, data, q_s, dq_s)
        world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        foot = pin.getFrameVelocity(model, data, self._stance, world).linear[PLANE]
        above = [pin.getVelocity(model, data, joint, world).linear[PLANE] for joint in self._joints]
        # turning what hangs on a joint turns its velocity relative to the joint
        return foot, np.column_stack([QUARTER_TURN @ (foot - joint) for joint in above])
