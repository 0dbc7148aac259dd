"""Is the robot that PyBullet loaded the one of the URDF?

PyBullet reads numbers by the locale of the process. After `setlocale(LC_ALL, "de_DE.UTF-8")`, as GUI toolkits call it,
it takes 4.384 kg for 4 kg. pinocchio reads the same file, whatever the locale.
"""

from typing import Any

import numpy as np
import pinocchio

RELATIVE, ABSOLUTE = 1e-9, 1e-12


class RobotError(RuntimeError):
    """A physics engine took another robot than it was given."""


def check_robot(client: Any, robot: int, urdf: str) -> None:
    """Compare masses, inertias, positions and limits of all joints that move, and of the links behind them.

    A joint's position is from the centre of mass of the link before.

    Raises:
        RobotError: one differs.
    """
    model = pinocchio.buildModelFromXML(urdf)
    infos = [client.getJointInfo(robot, number) for number in range(client.getNumJoints(robot))]
    loaded = {info[1].decode(): (info, client.getDynamicsInfo(robot, info[0])) for info in infos}
    for joint in range(1, model.njoints):
        name, inertia, at = model.names[joint], model.inertias[joint], model.idx_qs[joint]
        info, dynamics = loaded[name]
        place = model.jointPlacements[joint].translation - model.inertias[model.parents[joint]].lever
        limits = model.lowerPositionLimit[at], model.upperPositionLimit[at]
        for what, value, expected in (
            ("mass", dynamics[:1], [inertia.mass]),
            ("principal moments of inertia", sorted(dynamics[2]), np.linalg.eigvalsh(inertia.inertia)),
            ("centre of mass", dynamics[3], inertia.lever),
            ("position", info[14], place),
            ("limits", info[8:10], limits),
        ):
            if not np.allclose(value, expected, RELATIVE, ABSOLUTE):
                raise RobotError(
                    f"PyBullet: {what} at {name} is {list(value)}, in the URDF {np.array(expected).tolist()}. "
                    'If the locale has a decimal comma: locale.setlocale(locale.LC_NUMERIC, "C")'
                )
