"""Links that are heavier, lighter, bent or longer. Where the feet of such links are, `kinematics.py` knows."""

from xml.etree.ElementTree import Element

from rabbit_description.planar_urdf import scale_inertials

from rabbit_sim.perturbation import Control, Number, Perturbation, child, setting

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
