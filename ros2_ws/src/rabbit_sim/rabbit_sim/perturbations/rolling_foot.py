"""Feet that roll: a round sole in place of a point."""

from xml.etree.ElementTree import Element, SubElement

from rabbit_sim.perturbation import Control, EngineNumber, Perturbation, child, setting
from rabbit_sim.plant import FOOT_RADIUS


class RollingFoot(Perturbation):
    """The sole touches the ground below an upright shin where the point foot would, and ahead where the shin leans."""

    sole_radius: EngineNumber = setting(
        FOOT_RADIUS, FOOT_RADIUS, 0.2, "radius of the foot's round sole, m", Control("sole radius", 0.01, "m", high=0.1)
    )

    def change_robot(self, robot: Element) -> None:
        for side in ("left", "right"):
            collision = child(robot, f"link[@name='{side}_foot']/collision")
            SubElement(collision, "origin", xyz=f"0 0 {self.sole_radius - FOOT_RADIUS!r}")
            child(collision, "geometry/sphere").set("radius", repr(self.sole_radius))
