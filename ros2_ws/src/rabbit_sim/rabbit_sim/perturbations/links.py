"""Links that are heavier, lighter, bent or longer, feet that roll, and what the torso carries.

Where such feet are, `kinematics.py` knows.
"""

from xml.etree.ElementTree import Element, SubElement

from pydantic import model_validator
from rabbit_description.planar_urdf import scale_inertials
from rabbit_description.state import Array

from rabbit_sim.perturbation import Control, EngineNumber, Number, Perturbation, setting
from rabbit_sim.plant import FOOT_RADIUS

LEFT_LEG = ("left_thigh", "left_shin")
DISTAL_JOINTS = ("left_knee", "left_ankle", "right_knee", "right_ankle")
PENDULUM, CART = "swing_payload", "sliding_payload"
BOB_RADIUS = 1e-3  # m, of gyration
LEAST_PENDULUM = 1e-6  # kg; MuJoCo takes no moving body whose inertia is below 1e-15 kg m^2


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
            scale_inertials(next(robot.iterfind(f"link[@name='{name}']")), self.left_leg_scale)
        for name in DISTAL_JOINTS:
            origin = next(robot.iterfind(f"joint[@name='{name}']/origin"))
            length = -float(origin.attrib["xyz"].split()[2]) * self.leg_stretch
            origin.set("xyz", f"{self.link_bend * length!r} 0 {-length!r}")


class RollingFoot(Perturbation):
    """A round sole: under an upright shin it touches the ground where a point foot would, under a leaning one ahead."""

    sole_radius: EngineNumber = setting(
        FOOT_RADIUS, FOOT_RADIUS, 0.2, "radius of the foot's round sole, m", Control("sole radius", 0.01, "m", high=0.1)
    )

    def change_robot(self, robot: Element) -> None:
        for side in ("left", "right"):
            collision = next(robot.iterfind(f"link[@name='{side}_foot']/collision"))
            SubElement(collision, "origin", xyz=f"0 0 {self.sole_radius - FOOT_RADIUS!r}")
            next(collision.iterfind("geometry/sphere")).set("radius", repr(self.sole_radius))


class Payload(Perturbation):
    """A point mass fixed to the torso, one that hangs from it and swings, and one that slides; none is scaled."""

    order = 20
    acts_always = True  # with 0 kg too: (m h) / m is not always h to the last bit, and walks are kept to it

    payload: Number = setting(
        0.0, 0, 200, "point mass on the torso, kg", Control("payload", 1, "kg", high=80, first=True)
    )
    payload_height: Number = setting(0.24, -0.5, 1, "height of the payload above the hip, m")
    payload_ahead: Number = setting(
        0.0, -0.5, 0.5, "distance of the payload ahead of the hip, m", Control("payload ahead", 0.01, "m")
    )
    swing_payload: EngineNumber = setting(
        0.0, 0, 100, "mass of a pendulum that hangs at payload_height, kg", Control("swinging payload", 1, "kg")
    )
    swing_length: Number = setting(0.3, 0.05, 2, "length of the pendulum, m")

    sliding_payload: EngineNumber = setting(
        0.0, 0, 100, "mass that slides to and fro at payload_height, kg", Control("sliding payload", 1, "kg")
    )
    slide_length: Number = setting(0.1, 0.001, 0.5, "way of the sliding payload from the middle to either stop, m")

    @model_validator(mode="after")
    def _what_moves_has_mass(self) -> "Payload":
        for name in (PENDULUM, CART):
            if 0 < (mass := getattr(self, name)) < LEAST_PENDULUM:
                raise ValueError(f"{name} = {mass:g}: expected 0 or at least {LEAST_PENDULUM:g} kg")
        return self

    def change_robot(self, robot: Element) -> None:
        """Merge the point mass into the torso, whose CoM lies on its z axis (parallel-axis theorem).

        ixz stays out: nothing turns about x or z.
        """
        mass, ahead, height = self.payload, self.payload_ahead, self.payload_height
        inertial = next(robot.iterfind("link[@name='torso']/inertial"))
        origin, mass_element, inertia = (next(inertial.iterfind(name)) for name in ("origin", "mass", "inertia"))
        torso_height, torso_mass = float(origin.attrib["xyz"].split()[2]), float(mass_element.attrib["value"])
        total = torso_mass + mass
        reduced, above = torso_mass * mass / total, height - torso_height
        origin.set("xyz", f"{mass * ahead / total!r} 0 {(torso_mass * torso_height + mass * height) / total!r}")
        mass_element.set("value", repr(total))
        squares = {"ixx": above**2, "iyy": above**2 + ahead**2, "izz": ahead**2}
        for name, square in squares.items():
            inertia.set(name, repr(float(inertia.attrib[name]) + reduced * square))

    def attach(self, robot: Element) -> None:
        """Point masses: on a massless rod, free to swing about the torso; on a rail ahead, without friction."""
        for name, kind, axis, below, way in (
            (PENDULUM, "revolute", "0 1 0", self.swing_length, 1000.0),
            (CART, "prismatic", "1 0 0", 0.0, self.slide_length),
        ):
            if not (mass := getattr(self, name)):
                continue
            joint = SubElement(robot, "joint", name=name, type=kind)
            SubElement(joint, "limit", lower=repr(-way), upper=repr(way), effort="0", velocity="1000")
            SubElement(joint, "parent", link="torso")
            SubElement(joint, "child", link=f"{name}_bob")
            SubElement(joint, "origin", xyz=f"0 0 {self.payload_height!r}")
            SubElement(joint, "axis", xyz=axis)
            inertial = SubElement(SubElement(robot, "link", name=f"{name}_bob"), "inertial")
            SubElement(inertial, "origin", xyz=f"0 0 {-below!r}")
            SubElement(inertial, "mass", value=repr(mass))
            small = repr(mass * BOB_RADIUS**2)
            SubElement(inertial, "inertia", ixx=small, iyy=small, izz=small, ixy="0", ixz="0", iyz="0")

    def attached_at(self, q: Array, dq: Array, slope: float) -> dict[str, tuple[float, float]]:
        """The pendulum hangs along gravity and does not turn; what slides is in the middle and goes with the torso."""
        begins = {PENDULUM: (slope - q[2], -dq[2]), CART: (0.0, 0.0)}
        return {name: state for name, state in begins.items() if getattr(self, name)}
