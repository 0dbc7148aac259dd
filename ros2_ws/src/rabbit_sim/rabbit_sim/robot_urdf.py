"""The true robot's URDF: the nominal one as the perturbations change it."""

from functools import lru_cache
from xml.etree import ElementTree

from rabbit_description import URDF_PATH

from rabbit_sim.kinematics import LegShape
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.plant import FOOT_RADIUS


@lru_cache(maxsize=64)  # a batch has many robots, often the same
def perturbed_urdf(parameters: SimulationParameters) -> str:
    """URDF text of the robot with its seven coordinates, as the oracle knows it."""
    robot = ElementTree.parse(URDF_PATH).getroot()
    for perturbation in parameters.in_force():
        perturbation.change_robot(robot)
    return ElementTree.tostring(robot, encoding="unicode")


def leg_shape(parameters: SimulationParameters) -> LegShape:
    """The shape of the same robot's legs."""
    return LegShape.of(parameters.link_bend, parameters.leg_stretch, parameters.sole_radius - FOOT_RADIUS)


@lru_cache(maxsize=64)
def with_attached(urdf: str, parameters: SimulationParameters) -> str:
    """The robot with the links that perturbations attach."""
    robot = ElementTree.fromstring(urdf)
    for perturbation in parameters.in_force():
        perturbation.attach(robot)
    return ElementTree.tostring(robot, encoding="unicode")


@lru_cache(maxsize=4096)  # a batch has many robots, and asks in each tick of a flight
def true_mass(parameters: SimulationParameters) -> float:
    """The mass of the robot with all that it carries, kg."""
    robot = ElementTree.fromstring(with_attached(perturbed_urdf(parameters), parameters))
    return sum(float(mass.attrib["value"]) for mass in robot.iterfind("link/inertial/mass"))
