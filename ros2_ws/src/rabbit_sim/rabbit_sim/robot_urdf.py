"""The true robot's URDF: the nominal one with its perturbed masses and kinematics."""

from xml.etree import ElementTree
from xml.etree.ElementTree import Element

from rabbit_description import URDF_PATH
from rabbit_description.planar_urdf import scale_inertials
from rabbit_description.state import ROBOT_MASS

from rabbit_sim.parameters import SimulationParameters

DISTAL_JOINTS = ("left_knee", "left_ankle", "right_knee", "right_ankle")


def perturbed_urdf(parameters: SimulationParameters) -> str:
    """URDF text of the robot with `mass_scale`, then `payload` at `payload_height`, and `link_bend`."""
    robot = ElementTree.parse(URDF_PATH).getroot()
    scale_inertials(robot, parameters.mass_scale)
    _add_point_mass(_child(robot, "link[@name='torso']/inertial"), parameters.payload, parameters.payload_height)
    for name in DISTAL_JOINTS:
        _bend(_child(robot, f"joint[@name='{name}']/origin"), parameters.link_bend)
    return ElementTree.tostring(robot, encoding="unicode")


def true_mass(parameters: SimulationParameters) -> float:
    """Of the robot with all that it carries, kg."""
    return ROBOT_MASS * parameters.mass_scale + parameters.payload


def _child(element: Element, path: str) -> Element:
    found = element.find(path)
    if found is None:
        raise ValueError(f"{URDF_PATH}: no element {path}")
    return found


def _add_point_mass(inertial: Element, mass: float, height: float) -> None:
    """Merge a point mass at (0, 0, height) into a link whose CoM lies on its z axis (parallel-axis theorem)."""
    origin, mass_element, inertia = (_child(inertial, name) for name in ("origin", "mass", "inertia"))
    own_height, own_mass = float(origin.attrib["xyz"].split()[2]), float(mass_element.attrib["value"])
    total = own_mass + mass
    reduced_inertia = own_mass * mass / total * (height - own_height) ** 2
    origin.set("xyz", f"0 0 {(own_mass * own_height + mass * height) / total!r}")
    mass_element.set("value", repr(total))
    for name in ("ixx", "iyy"):
        inertia.set(name, repr(float(inertia.attrib[name]) + reduced_inertia))


def _bend(origin: Element, bend: float) -> None:
    """Shift the distal joint forward by `bend` times the link's length."""
    length = -float(origin.attrib["xyz"].split()[2])
    origin.set("xyz", f"{bend * length!r} 0 {-length!r}")
