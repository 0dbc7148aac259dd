"""The numbers of a planar robot, as `planar_robot.robot_parameters` orders them, read from its URDF by pinocchio.

`Feet`: where these numbers put its swing foot; for what is computed once a step.
"""

from dataclasses import dataclass, field, replace

import casadi as ca
import numpy as np
import pinocchio as pin
from cbf_clf_qp.functions import NumpyFunction, Values
from rabbit_description import URDF_PATH
from rabbit_description.planar_urdf import BASE
from rabbit_description.state import SWAP_TORQUE, Array
from rabbit_description.validation import one_line

from rl_cbf_clf_controller.planar_robot import PinnedRobot, Structure

PLANE = [0, 2]  # x and z of a spatial vector
PLANAR = [0, 1, 3, 6]  # m, m c_x, m c_z, I_yy among pinocchio's ten of a link
GRAVITY = np.array([0.0, 9.81])  # m/s^2, upwards
MIRRORED = [0, *(1 + SWAP_TORQUE)]  # RABBIT's links with the legs exchanged


@dataclass(frozen=True)
class RobotNumbers:
    """One robot: arrays by the names and with the units of `robot_parameters`; `names` of its joints after the base."""

    structure: Structure
    links: Array
    joints: Array
    feet: Array
    motor_gain: Array
    joint_damping: float = 0.0
    coulomb: float = 0.0
    gravity: Array = field(default_factory=lambda: GRAVITY)
    names: tuple[str, ...] = ()

    @property
    def row(self) -> Array:
        """All of them, in order."""
        arrays = self.links, self.joints, self.feet, self.motor_gain, self.joint_damping, self.coulomb, self.gravity
        return np.concatenate([np.ravel(array) for array in arrays])

    @property
    def theta(self) -> Array:
        """(12,) of RABBIT: m, m c_x, m c_z, I_yy of torso, thigh and shin; the left leg's, if they differ."""
        return self.links[:3].ravel()

    def mirrored(self) -> "RobotNumbers":
        """RABBIT with its right leg as the stance leg: the masses and motors of the legs change places."""
        return replace(self, links=self.links[MIRRORED], motor_gain=self.motor_gain[SWAP_TORQUE])


class Feet:
    """`stance` (2,) in the world, `swing` (2,) from there, m, and its `jacobian` (2, n), at q (n,).

    `function`: these of q and `lengths`. One object serves one thread.
    """

    def __init__(self, numbers: RobotNumbers) -> None:
        robot = PinnedRobot(numbers.structure)
        self.lengths = numbers.joints, numbers.feet
        inputs = {"q": robot.q, "joints": robot.parameters["joints"], "feet": robot.parameters["feet"]}
        feet = {"stance": robot.feet[0], "swing": robot.swing, "jacobian": ca.jacobian(robot.swing, robot.q)}
        self.function = NumpyFunction.of("feet", inputs, feet)

    def __call__(self, q_s: Array) -> Values:
        """The numbers at coordinates in stance/swing order."""
        return self.function(q_s, *self.lengths)


def read_robot(urdf: str | None = None, feet: tuple[str, str] = ("left_foot", "right_foot")) -> RobotNumbers:
    """The numbers of a URDF, RABBIT's if none is given; `feet` are the links of the stance and of the swing foot.

    Raises:
        ValueError: a robot that is not planar, has no such feet, or a link without mass where a joint moves it.
    """
    try:
        model = pin.buildModelFromXML(urdf or URDF_PATH.read_text(encoding="utf-8"))
    except Exception as error:  # of several kinds
        raise ValueError(f"URDF: {one_line(error)}") from error
    _check(model, feet)
    first = BASE + 1  # joint of the first link after the torso
    parents = tuple(int(parent) - BASE for parent in list(model.parents)[first:])
    frames = [model.frames[model.getFrameId(foot)] for foot in feet]
    structure = Structure(parents, (frames[0].parentJoint - BASE, frames[1].parentJoint - BASE))
    return RobotNumbers(
        structure,
        links=np.array([inertia.toDynamicParameters()[PLANAR] for inertia in list(model.inertias)[BASE:]]),
        joints=np.array([placement.translation[PLANE] for placement in list(model.jointPlacements)[first:]]),
        feet=np.array([frame.placement.translation[PLANE] for frame in frames]),
        motor_gain=np.ones(structure.motors),
        names=tuple(list(model.names)[first:]),
    )


def _check(model: pin.Model, feet: tuple[str, str]) -> None:
    kinds = [model.joints[i].shortname() for i in range(1, model.njoints)]
    wanted = ["JointModelPX", "JointModelPZ", *["JointModelRY"] * (model.njoints - 3)]
    if kinds != wanted or model.njoints < BASE + 2:
        raise ValueError(f"URDF {model.name}: joints {kinds}; expected {wanted}: slides x and z, then turns about y")
    for joint in range(1, model.njoints):
        placement = model.jointPlacements[joint]
        is_level = np.array_equal(placement.rotation, np.eye(3)) and (joint > BASE or not placement.translation.any())
        if not is_level or (joint < BASE and model.inertias[joint].mass != 0):
            raise ValueError(f"URDF {model.name}: {model.names[joint]}: expected frames in the plane, not turned")
    for joint in range(BASE, model.njoints):
        if not model.inertias[joint].mass > 0:
            said = f"mass {model.inertias[joint].mass:g} of what the joint {model.names[joint]} moves"
            raise ValueError(f"URDF {model.name}: {said}: expected a positive mass")
    if missing := [foot for foot in feet if not model.existFrame(foot)]:
        raise ValueError(f"URDF {model.name}: no link {', '.join(missing)} for a foot")
