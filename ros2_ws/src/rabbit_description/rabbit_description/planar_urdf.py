"""URDF texts of planar robots: a base that moves in the plane, heavier or lighter links."""

import math
from xml.etree import ElementTree
from xml.etree.ElementTree import Element

BASE_JOINTS = ("base_x", "base_z", "base_pitch")  # the first of a planar robot: two slides and the pitch
BASE = len(BASE_JOINTS)
SLIDES = 2  # those of the base that a standing foot takes up
INERTIA = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


class UrdfError(ValueError):
    """A URDF that is no planar robot: names the element and what was expected."""


def with_planar_base(urdf: str) -> str:
    """The robot with its root link on the joints `BASE_JOINTS`: x forward, z up, pitch about +y.

    As it is, if it has them.

    Raises:
        UrdfError: see `_parsed`, or not one root link.
    """
    robot = _parsed(urdf)
    if {joint.get("name") for joint in robot.iterfind("joint")} >= set(BASE_JOINTS):
        return urdf
    children = {child.get("link") for child in robot.iterfind("joint/child")}
    roots = [link.get("name", "") for link in robot.iterfind("link") if link.get("name") not in children]
    if len(roots) != 1:
        raise UrdfError(f"URDF {robot.get('name')}: root links {roots}; expected one")
    links = ("world", "slide_x", "slide_z")
    for name in links:
        ElementTree.SubElement(robot, "link", name=name)
    kinds = (("prismatic", "1 0 0"), ("prismatic", "0 0 1"), ("revolute", "0 1 0"))
    for name, parent, child, (kind, axis) in zip(BASE_JOINTS, links, (*links[1:], *roots), kinds, strict=True):
        joint = ElementTree.SubElement(robot, "joint", name=name, type=kind)
        ElementTree.SubElement(joint, "parent", link=parent)
        ElementTree.SubElement(joint, "child", link=child)
        ElementTree.SubElement(joint, "axis", xyz=axis)
        ElementTree.SubElement(joint, "limit", lower="-1e6", upper="1e6", effort="0", velocity="1000")
    return ElementTree.tostring(robot, encoding="unicode")


def scale_inertials(robot: Element, factor: float) -> None:
    """Multiply every mass and inertia in place."""
    for tag, names in (("mass", ("value",)), ("inertia", INERTIA)):
        for element in robot.iterfind(f".//inertial/{tag}"):
            for name in names:
                element.set(name, repr(float(element.attrib[name]) * factor))


def _parsed(urdf: str) -> Element:
    """The root; raises `UrdfError`: not XML, a mass or inertia that no link can have, or a place that is none."""
    try:
        robot = ElementTree.fromstring(urdf)
    except ElementTree.ParseError as error:
        raise UrdfError(f"URDF: not XML: {error}") from error
    for link in robot.iterfind("link"):
        for tag, name in (("mass", "value"), ("inertia", "ixx"), ("inertia", "iyy"), ("inertia", "izz")):
            for element in link.iterfind(f"inertial/{tag}"):
                if not 0 <= _number(element.get(name)) < math.inf:
                    said = f"{tag} {name} = {element.get(name)}"
                    raise UrdfError(f"URDF {robot.get('name')}: link {link.get('name')}: {said}: expected 0 or more")
    for element in robot.iter():  # pinocchio drops the inertia of a link whose place it cannot read
        for name, text in ((name, element.get(name, "0 0 0")) for name in ("xyz", "rpy")):
            if not (len(text.split()) == 3 and all(math.isfinite(_number(word)) for word in text.split())):
                raise UrdfError(f"URDF {robot.get('name')}: {element.tag} {name} = {text}: expected 3 finite numbers")
    return robot


def _number(text: str | None) -> float:
    try:
        return float(text or "")
    except ValueError:
        return math.nan
