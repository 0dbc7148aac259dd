"""Is the robot that PyBullet loaded the one of the URDF?

PyBullet reads numbers by the locale of the process. After `setlocale(LC_ALL, "de_DE.UTF-8")`, as GUI toolkits call it,
it takes 4.384 kg for 4 kg. Python's own `float` does not depend on the locale.
"""

from typing import Any
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

import numpy as np
from rabbit_description.state import Array

from rabbit_sim.perturbation import child

RELATIVE, ABSOLUTE = 1e-9, 1e-12
FIXED = (0.0, -1.0)  # PyBullet's limits of a joint without any


class RobotError(RuntimeError):
    """A physics engine took another robot than it was given."""


def check_robot(client: Any, robot: int, urdf: str) -> None:
    """Compare masses, inertias, positions and joint limits.

    Raises:
        RobotError: one differs.
    """
    infos = [client.getJointInfo(robot, joint) for joint in range(client.getNumJoints(robot))]
    loaded = {info[1].decode(): (info, client.getDynamicsInfo(robot, info[0])) for info in infos}
    for name, expected in _joints(urdf).items():
        info, dynamics = loaded[name]
        found = {
            "mass": np.array([dynamics[0]]),
            "principal moments of inertia": np.sort(dynamics[2]),
            "centre of mass": np.array(dynamics[3]),
            "position": np.array(info[14]),
            "limits": np.array(info[8:10]),
        }
        for what, value in found.items():
            if not np.allclose(value, expected[what], RELATIVE, ABSOLUTE):
                raise RobotError(
                    f"PyBullet: {what} at {name} is {value.tolist()}, in the URDF {expected[what].tolist()}. "
                    'If the locale has a decimal comma: locale.setlocale(locale.LC_NUMERIC, "C")'
                )


def _joints(urdf: str) -> dict[str, dict[str, Array]]:
    """Of each joint and of the link behind it; a position is from the centre of mass of the link before."""
    robot = ElementTree.fromstring(urdf)
    links = {link.get("name"): link.find("inertial") for link in robot.iter("link")}
    found = {}
    for joint in robot.iter("joint"):
        before, behind = (links[child(joint, end).get("link")] for end in ("parent", "child"))
        limit = joint.find("limit")
        limits = FIXED if limit is None else (float(limit.get("lower", 0)), float(limit.get("upper", 0)))
        found[joint.get("name", "")] = {
            "mass": np.array([0.0 if behind is None else float(child(behind, "mass").get("value", "nan"))]),
            "principal moments of inertia": _moments(behind),
            "centre of mass": _position(behind),
            "position": _position(joint) - _position(before),
            "limits": np.array(limits),
        }
    return found


def _position(element: Element | None) -> Array:
    origin = None if element is None else element.find("origin")
    return np.zeros(3) if origin is None else np.array([float(each) for each in origin.get("xyz", "0 0 0").split()])


def _moments(inertial: Element | None) -> Array:
    if inertial is None:
        return np.zeros(3)
    given = child(inertial, "inertia").attrib
    moments: Array = np.linalg.eigvalsh([[float(given[f"i{min(p, q)}{max(p, q)}"]) for q in "xyz"] for p in "xyz"])
    return moments
