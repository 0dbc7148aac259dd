"""Is the robot that PyBullet loaded the one of the URDF?

PyBullet reads numbers by the locale of the process. After `setlocale(LC_ALL, "de_DE.UTF-8")`, as GUI toolkits call it,
it takes 4.384 kg for 4 kg. pinocchio reads the same file, whatever the locale.
"""

from typing import Any

import numpy as np
import pinocchio
from rabbit_description.state import Array

RELATIVE, ABSOLUTE = 1e-9, 1e-12
FIXED = (0.0, -1.0)  # PyBullet's limits of a joint that does not move


class RobotError(RuntimeError):
    """A physics engine took another robot than it was given."""


def check_robot(client: Any, robot: int, urdf: str) -> None:
    """Compare masses, inertias, positions and joint limits.

    Raises:
        RobotError: one differs.
    """
    model = pinocchio.buildModelFromXML(urdf)
    for number in range(client.getNumJoints(robot)):
        info, dynamics = client.getJointInfo(robot, number), client.getDynamicsInfo(robot, number)
        name = info[1].decode()
        found = {
            "mass": dynamics[0],
            "principal moments of inertia": sorted(dynamics[2]),
            "centre of mass": dynamics[3],
            "position": info[14],
            "limits": info[8:10],
        }
        for what, expected in _joint(model, name).items():
            value = np.atleast_1d(found[what])
            if not np.allclose(value, expected, RELATIVE, ABSOLUTE):
                raise RobotError(
                    f"PyBullet: {what} at {name} is {value.tolist()}, in the URDF {expected.tolist()}. "
                    'If the locale has a decimal comma: locale.setlocale(locale.LC_NUMERIC, "C")'
                )


def _joint(model: pinocchio.Model, name: str) -> dict[str, Array]:
    """What is known of a joint and of the link behind it; its position is from the centre of mass of the link before.

    Behind a joint that does not move there is a link without mass.
    """
    frame = model.frames[model.getFrameId(name)]
    parent, place, inertia, limits = frame.parentJoint, frame.placement, pinocchio.Inertia.Zero(), FIXED
    if model.existJointName(name):
        joint = model.getJointId(name)
        parent, place, inertia = model.parents[joint], model.jointPlacements[joint], model.inertias[joint]
        at = model.idx_qs[joint]
        limits = model.lowerPositionLimit[at], model.upperPositionLimit[at]
    return {
        "mass": np.array([inertia.mass]),
        "principal moments of inertia": np.linalg.eigvalsh(inertia.inertia),
        "centre of mass": inertia.lever,
        "position": place.translation - model.inertias[parent].lever,
        "limits": np.array(limits),
    }
