"""The true robot's URDF: the nominal one with its perturbed masses and kinematics."""

from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from rabbit_description import URDF_PATH
from rabbit_description.planar_urdf import scale_inertials
from rabbit_description.state import ROBOT_MASS

from rabbit_sim.parameters import SimulationParameters

LEFT_LEG = ("left_thigh", "left_shin")
LEG_MASS = 10.0  # kg, nominal, thigh and shin
PENDULUM = "swing_payload"
BOB_RADIUS = 1e-3  # m, of gyration
DISTAL_JOINTS = ("left_knee", "left_ankle", "right_knee", "right_ankle")


def perturbed_urdf(parameters: SimulationParameters) -> str:
    """URDF text with `mass_scale`, then `left_leg_scale`, the payload where it is, and `link_bend`; no pendulum."""
    robot = ElementTree.parse(URDF_PATH).getroot()
    scale_inertials(robot, parameters.mass_scale)
    for name in LEFT_LEG:
        _scale(_child(robot, f"link[@name='{name}']/inertial"), parameters.left_leg_scale)
    at = parameters.payload_ahead, parameters.payload_height
    _add_point_mass(_child(robot, "link[@name='torso']/inertial"), parameters.payload, *at)
    for name in DISTAL_JOINTS:
        _bend(_child(robot, f"joint[@name='{name}']/origin"), parameters.link_bend)
    return ElementTree.tostring(robot, encoding="unicode")


def with_pendulum(urdf: str, parameters: SimulationParameters) -> str:
    """The robot with `swing_payload` hung to its torso: a point mass on a massless rod, free to swing."""
    if not parameters.swing_payload:
        return urdf
    robot = ElementTree.fromstring(urdf)
    joint = SubElement(robot, "joint", name=PENDULUM, type="revolute")
    SubElement(joint, "limit", lower="-1000", upper="1000", effort="0", velocity="1000")
    SubElement(joint, "parent", link="torso")
    SubElement(joint, "child", link=f"{PENDULUM}_bob")
    SubElement(joint, "origin", xyz=f"0 0 {parameters.payload_height!r}")
    SubElement(joint, "axis", xyz="0 1 0")
    inertial = SubElement(SubElement(robot, "link", name=f"{PENDULUM}_bob"), "inertial")
    SubElement(inertial, "origin", xyz=f"0 0 {-parameters.swing_length!r}")
    SubElement(inertial, "mass", value=repr(parameters.swing_payload))
    small = repr(parameters.swing_payload * BOB_RADIUS**2)
    SubElement(inertial, "inertia", ixx=small, iyy=small, izz=small, ixy="0", ixz="0", iyz="0")
    return ElementTree.tostring(robot, encoding="unicode")


def true_mass(parameters: SimulationParameters) -> float:
    """Of the robot with all that it carries, kg."""
    legs = LEG_MASS * (parameters.left_leg_scale - 1)
    return (ROBOT_MASS + legs) * parameters.mass_scale + parameters.payload + parameters.swing_payload


def _child(element: Element, path: str) -> Element:
    found = element.find(path)
    if found is None:
        raise ValueError(f"{URDF_PATH}: no element {path}")
    return found


def _scale(inertial: Element, factor: float) -> None:
    """Mass and inertia of a link."""
    for element in (_child(inertial, "mass"), _child(inertial, "inertia")):
        for name, value in element.attrib.items():
            element.set(name, repr(factor * float(value)))


def _add_point_mass(inertial: Element, mass: float, ahead: float, height: float) -> None:
    """Merge a point mass at (ahead, 0, height) into a link whose CoM lies on its z axis (parallel-axis theorem).

    ixz stays out: nothing turns about x or z.
    """
    origin, mass_element, inertia = (_child(inertial, name) for name in ("origin", "mass", "inertia"))
    own_height, own_mass = float(origin.attrib["xyz"].split()[2]), float(mass_element.attrib["value"])
    total = own_mass + mass
    reduced = own_mass * mass / total
    origin.set("xyz", f"{mass * ahead / total!r} 0 {(own_mass * own_height + mass * height) / total!r}")
    mass_element.set("value", repr(total))
    squares = {"ixx": (height - own_height) ** 2, "iyy": (height - own_height) ** 2 + ahead**2, "izz": ahead**2}
    for name, square in squares.items():
        inertia.set(name, repr(float(inertia.attrib[name]) + reduced * square))


def _bend(origin: Element, bend: float) -> None:
    """Shift the distal joint forward by `bend` times the link's length."""
    length = -float(origin.attrib["xyz"].split()[2])
    origin.set("xyz", f"{bend * length!r} 0 {-length!r}")
