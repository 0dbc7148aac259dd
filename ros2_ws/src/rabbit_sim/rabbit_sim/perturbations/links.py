"""Links that are heavier, lighter, bent or longer, and feet that roll. Where such feet are, `kinematics.py` knows."""

from xml.etree.ElementTree import Element, SubElement

from rabbit_description.planar_urdf import scale_inertials

from rabbit_sim.perturbation import Control, EngineNumber, Number, Perturbation, child, setting
from rabbit_sim.plant import FOOT_RADIUS

LEFT_LEG = ("left_thigh", "left_shin")
DISTAL_JOINTS = ("left_knee", "left_ankle", "right_knee", "right_ankle")


class Links(Perturbation):
    """Changes of the nominal robot, before it carries anything."""

    order = 10

    mass_scale: Number = setting(
        1.0, 0.1, 10, "factor on every true mass and inertia", Control("mass scale", 0.05, low=0.5, high=3, first=True)
    )
    left_leg_scale: Number = setting(
        1.0, 0.5, 2, "factor on the left leg's masses and inertias", Control("left leg", 0.05)
    )
    link_bend: Number = setting(0.0, -0.3, 0.3, "forward shift of knee and foot over link length")
    leg_stretch: Number = setting(1.0, 0.9, 1.1, "factor on the lengths of thighs and shins; their masses stay")

    def change_robot(self, robot: Element) -> None:
        scale_inertials(robot, self.mass_scale)
        for name in LEFT_LEG:
            scale_inertials(child(robot, f"link[@name='{name}']"), self.left_leg_scale)
        for name in DISTAL_JOINTS:
            origin = child(robot, f"joint[@name='{name}']/origin")
            length = -float(origin.attrib["xyz"].split()[2]) * self.leg_stretch
            origin.set("xyz", f"{self.link_bend * length!r} 0 {-length!r}")


class RollingFoot(Perturbation):
    """A round sole: under an upright shin it touches the ground where a point foot would, under a leaning one ahead."""

    sole_radius: EngineNumber = setting(
        FOOT_RADIUS, FOOT_RADIUS, 0.2, "radius of the foot's round sole, m", Control("sole radius", 0.01, "m", high=0.1)
    )

    def change_robot(self, robot: Element) -> None:
        for side in ("left", "right"):
            collision = child(robot, f"link[@name='{side}_foot']/collision")
            SubElement(collision, "origin", xyz=f"0 0 {self.sole_radius - FOOT_RADIUS!r}")
            child(collision, "geometry/sphere").set("radius", repr(self.sole_radius))
