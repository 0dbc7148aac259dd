"""The robot as `nominal_model.py` has it, computed by generated C; and the one place that chooses between the two."""

import ctypes
from dataclasses import dataclass

import numpy as np
import pinocchio as pin
from cbf_clf_qp import tracing
from cbf_clf_qp.affine import Affine
from rabbit_description.state import Array

from rl_cbf_clf_controller import link_parameters as links
from rl_cbf_clf_controller.foot_velocity import FootVelocity
from rl_cbf_clf_controller.generated.calls import generated
from rl_cbf_clf_controller.generated.layout import FOOT_VELOCITY, LINKS, PINNED, REGRESSOR
from rl_cbf_clf_controller.generated.library import GeneratedFunction, load_library
from rl_cbf_clf_controller.nominal_model import PLANE, NominalModel
from rl_cbf_clf_controller.pinned_robot import Kinematics, PinnedDynamics

JOINTS = ("base_x", "base_z", "base_pitch", "left_hip", "left_knee", "right_hip", "right_knee")
CARRIERS = (JOINTS[2], *JOINTS[3:])  # of LINKS
FEET = ("left_foot", "right_foot")
PITCH_AXIS = "JointModelRY"


class GeneratedModel:
    """Pinned-foot dynamics of a planar robot with RABBIT's joints, of whatever lengths and masses.

    The same interface as `NominalModel`, the same numbers but for rounding.

    Raises:
        ValueError: the model has other joints.
    """

    computed_by = "generated code"

    def __init__(
        self, library: ctypes.CDLL, model: pin.Model, motor_gain: float = 1.0, joint_damping: float = 0.0
    ) -> None:
        if not has_layout(model):
            raise ValueError(f"joints {list(model.names)[1:]}: expected those of RABBIT")
        self.model = model
        self._function = GeneratedFunction(library, PINNED)
        self._arguments, at = self._function.arguments, self._function.argument_slices
        self._q, self._dq, self._links = at["q"], at["dq"], at["links"]
        self._motor_gain, self._joint_damping = at["motor_gain"], at["joint_damping"]
        self._arguments[at["legs"]] = leg_lengths(model)
        self._believe(link_parameters(model), motor_gain, joint_damping)

    def believe(self, theta: Array, motor_gain: float, joint_damping: float) -> None:
        """Take over links theta (12,), as in `link_parameters.py`, motors and damping."""
        torso, thigh, shin = theta.reshape(3, 4)
        self._believe(np.concatenate([torso, thigh, shin, thigh, shin]), motor_gain, joint_damping)

    def _believe(self, links: Array, motor_gain: float, joint_damping: float) -> None:
        self._arguments[self._links] = links
        self._arguments[self._motor_gain], self._arguments[self._joint_damping] = motor_gain, joint_damping
        self._robot = GeneratedRobot(self._arguments[self._links.start :].copy())

    def update(self, q_s: Array, dq_s: Array) -> Kinematics:
        """Compute all terms at a state `q_s`, `dq_s` (7,), stance/swing order, and return the feet's kinematics."""
        self._arguments[self._q], self._arguments[self._dq] = q_s, dq_s
        self._results = found = self._function()
        return feet_of(found)

    def pinned(self) -> PinnedDynamics:
        """Acceleration and contact force at the state of the last `update`."""
        return dynamics_of(self._results)

    def robot_at(self, q_s: Array, dq_s: Array) -> "GeneratedRobot":
        """For a trace, which computes all of it."""
        return self._robot


@dataclass(frozen=True)
class GeneratedRobot:
    """The `numbers` of a robot as in `layout.ROBOT`, of which a trace computes all the rest."""

    numbers: Array

    def at(self, q_s: Array, dq_s: Array) -> tuple[Kinematics, PinnedDynamics]:
        """At a state `q_s`, `dq_s` (7,), stance/swing order."""
        found = generated(PINNED, q_s, dq_s, self.numbers)
        return feet_of(found), dynamics_of(found)


# as in layout.FUNCTIONS[PINNED]; a test compares


def feet_of(found: Array) -> Kinematics:
    """In the results."""
    return Kinematics(
        swing=found[:2],
        swing_rate=found[2:4],
        swing_jacobian=found[4:18].reshape(2, 7),
        swing_bias=found[18:20],
        hip=found[20:22],
        hip_rate=found[22:24],
    )


def dynamics_of(found: Array) -> PinnedDynamics:
    """In the results."""
    return PinnedDynamics(
        acceleration=Affine(found[24:52].reshape(7, 4), found[52:59]),
        force=Affine(found[59:67].reshape(2, 4), found[67:69]),
    )


def has_layout(model: pin.Model) -> bool:
    """Whether the joints are RABBIT's, all in one plane, with massless slides."""
    if tuple(model.names)[1:] != JOINTS or not all(model.existFrame(foot) for foot in FEET):
        return False
    turning = [model.joints[i].shortname() == PITCH_AXIS for i in range(3, 8)]
    sliding = [model.joints[i + 1].shortname() == kind for i, kind in enumerate(("JointModelPX", "JointModelPZ"))]
    placed = [np.array_equal(model.jointPlacements[i].rotation, np.eye(3)) for i in range(1, 8)]
    at_origin = [not model.jointPlacements[i].translation.any() for i in range(1, 4)]
    massless = [model.inertias[i].mass == 0 for i in range(1, 3)]
    parents = list(model.parents)[1:] == [0, 1, 2, 3, 4, 3, 6]
    level = np.array_equal(model.gravity.linear, [0, 0, -9.81])
    return parents and level and all(turning + sliding + placed + at_origin + massless)


def link_parameters(model: pin.Model) -> Array:
    """(20,): theta of each of `LINKS`, stance being left."""
    inertias = [model.inertias[model.getJointId(name)] for name in CARRIERS]
    assert len(inertias) == len(LINKS)
    return np.concatenate([inertia.toDynamicParameters()[links.PLANAR] for inertia in inertias])


def leg_lengths(model: pin.Model) -> Array:
    """(12,): hip, knee and foot of the left, then of the right leg, x and z in the frame of the joint above, m."""
    points = []
    for side, foot in zip(("left", "right"), FEET, strict=True):
        points += [model.jointPlacements[model.getJointId(f"{side}_{name}")] for name in ("hip", "knee")]
        points.append(model.frames[model.getFrameId(foot)].placement)
    return np.concatenate([point.translation[PLANE] for point in points])


@dataclass(frozen=True)
class GeneratedMotionTerms:
    """`MotionTerms` of a robot with RABBIT's joints and such `legs` (12,), see `leg_lengths`; also in a trace."""

    legs: Array

    def __call__(self, q: Array, dq: Array, ddq: Array, theta: Array) -> tuple[Array, Array, Array]:
        """Y (7, 12), M (7, 7) of the links theta (12,), and the feet's Jacobians (2, 2, 7), stance and swing."""
        found = generated(REGRESSOR, q, dq, ddq, theta, self.legs)
        # as in layout.FUNCTIONS[REGRESSOR]; a test compares
        return found[:84].reshape(7, 12), found[84:133].reshape(7, 7), found[133:].reshape(2, 2, 7)


@dataclass(frozen=True)
class GeneratedFootVelocity:
    """`FootVelocity` of a robot with RABBIT's joints and such `legs` (12,), see `leg_lengths`; also in a trace."""

    legs: Array

    def __call__(self, q_s: Array, dq_s: Array) -> tuple[Array, Array]:
        """Velocity (2,), m/s, and its slope (2, 2) over the stance leg's hip and knee angle."""
        found = generated(FOOT_VELOCITY, q_s, dq_s, self.legs)
        return found[:2], found[2:].reshape(2, 2)


def library_for(model: pin.Model) -> ctypes.CDLL | None:
    """The generated code, if it is built and the model has RABBIT's joints; else pinocchio computes."""
    return load_library() if has_layout(model) else None


def make_motion_terms(model: pin.Model) -> GeneratedMotionTerms | links.MotionTerms:
    """What the identification takes from a model."""
    return GeneratedMotionTerms(leg_lengths(model)) if library_for(model) else links.MotionTerms(model)


def make_foot_velocity(model: pin.Model) -> GeneratedFootVelocity | FootVelocity:
    """The stance foot's velocity and its slope."""
    return GeneratedFootVelocity(leg_lengths(model)) if library_for(model) else FootVelocity(model)


def make_model(
    urdf: str | None = None, motor_gain: float = 1.0, joint_damping: float = 0.0
) -> GeneratedModel | NominalModel:
    """The model that a tick uses: generated code if it is built and `urdf` has RABBIT's joints, else pinocchio."""
    return generated_if_built(NominalModel(urdf, motor_gain, joint_damping))


def generated_if_built(model: NominalModel) -> GeneratedModel | NominalModel:
    """The same robot by generated code, if that is built for it."""
    library = library_for(model.model)
    return GeneratedModel(library, model.model, model.motor_gain, model.joint_damping) if library else model


def arithmetic(model: GeneratedModel | NominalModel) -> str:
    """What computes a tick; two of these differ by rounding."""
    return f"{model.computed_by}, {'traced by CasADi' if tracing.ENABLED else 'numpy'}"
