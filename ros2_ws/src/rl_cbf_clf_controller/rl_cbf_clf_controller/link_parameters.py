"""The links' inertial parameters as a vector, in which the equations of motion are linear.

For a link, in the frame of the joint that carries it: m, m c_x, m c_z, I_yy, in kg, kg m, kg m, kg m^2; c is its CoM.
Thighs are alike and shins are alike, so that theta (12,) has torso, thigh, shin. With pinocchio's regressor Y (7, 12)

    M(q) q'' + bias_forces(q, q') = Y(q, q', q'') theta

Source: Khalil and Dombre, Modeling, Identification and Control of Robots (2002), chapter 12.
"""

import numpy as np
import pinocchio as pin
from rabbit_description.state import Array

JOINTS = (("base_pitch",), ("left_hip", "right_hip"), ("left_knee", "right_knee"))  # that carry torso, thighs, shins
PLANAR = [0, 1, 3, 6]  # m, m c_x, m c_z, I_yy among pinocchio's ten of a link
OUT_OF_PLANE = [4, 9]  # I_xx, I_zz, which no planar motion feels
SIZE = len(JOINTS) * len(PLANAR)


def link_joints(model: pin.Model) -> list[list[int]]:
    """Indices of `JOINTS` in a model."""
    return [[model.getJointId(name) for name in names] for names in JOINTS]


def read_links(model: pin.Model) -> Array:
    """theta (12,) of a model."""
    first = [joints[0] for joints in link_joints(model)]
    return np.concatenate([model.inertias[joint].toDynamicParameters()[PLANAR] for joint in first])


def write_links(model: pin.Model, theta: Array) -> None:
    """Give a model the links theta (12,); their masses must not be 0."""
    for values, joints in zip(theta.reshape(len(JOINTS), len(PLANAR)), link_joints(model), strict=True):
        parameters = np.zeros(10)
        parameters[PLANAR] = values
        parameters[OUT_OF_PLANE] = values[-1]
        for joint in joints:
            model.inertias[joint] = pin.Inertia.FromDynamicParameters(parameters)


def is_physical(theta: Array) -> bool:
    """Whether every link has a mass and, about its centre of mass, an inertia."""
    links = theta.reshape(len(JOINTS), len(PLANAR)).tolist()
    return all(mass > 0 and inertia * mass > mc_x**2 + mc_z**2 for mass, mc_x, mc_z, inertia in links)


class MotionTerms:
    """What the identification takes from a model, computed by pinocchio."""

    def __init__(self, model: pin.Model) -> None:
        self._model, self._data = model.copy(), model.createData()
        self._feet = [model.getFrameId(name) for name in ("left_foot", "right_foot")]

    def __call__(self, q: Array, dq: Array, ddq: Array, theta: Array) -> tuple[Array, Array, Array]:
        """Y (7, 12), M (7, 7) of the links theta (12,), and the feet's Jacobians (2, 2, 7), stance and swing."""
        model, data = self._model, self._data
        write_links(model, theta)
        upper = np.triu(pin.crba(model, data, q))
        pin.computeJointJacobians(model, data, q)
        pin.updateFramePlacements(model, data)
        world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        jacobians = np.array([pin.getFrameJacobian(model, data, foot, world)[[0, 2]] for foot in self._feet])
        return motion_regressor(model, data, q, dq, ddq), upper + np.triu(upper, 1).T, jacobians


def motion_regressor(model: pin.Model, data: pin.Data, q: Array, dq: Array, ddq: Array) -> Array:
    """Y (7, 12); none of the model's own inertias is in it."""
    whole = pin.computeJointTorqueRegressor(model, data, q, dq, ddq).reshape(model.nv, -1, 10)[:, :, PLANAR]
    links = [whole[:, [joint - 1 for joint in joints]].sum(axis=1) for joints in link_joints(model)]
    return np.hstack(links)
