"""What the torso carries: a point mass fixed to it, and one that hangs from it and swings."""

from xml.etree.ElementTree import Element, SubElement

from pydantic import model_validator
from rabbit_description.state import Array

from rabbit_sim.perturbation import Control, EngineNumber, Number, Perturbation, child, setting

PENDULUM = "swing_payload"
BOB_RADIUS = 1e-3  # m, of gyration
LEAST_PENDULUM = 1e-6  # kg; MuJoCo takes no moving body whose inertia is below 1e-15 kg m^2


class Payload(Perturbation):
    """Neither is scaled with the robot's masses."""

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

    @model_validator(mode="after")
    def _pendulum_has_mass(self) -> "Payload":
        if 0 < self.swing_payload < LEAST_PENDULUM:
            raise ValueError(f"swing_payload = {self.swing_payload:g}: expected 0 or at least {LEAST_PENDULUM:g} kg")
        return self

    def change_robot(self, robot: Element) -> None:
        """Merge the point mass into the torso, whose CoM lies on its z axis (parallel-axis theorem).

        ixz stays out: nothing turns about x or z.
        """
        mass, ahead, height = self.payload, self.payload_ahead, self.payload_height
        inertial = child(robot, "link[@name='torso']/inertial")
        origin, mass_element, inertia = (child(inertial, name) for name in ("origin", "mass", "inertia"))
        own_height, own_mass = float(origin.attrib["xyz"].split()[2]), float(mass_element.attrib["value"])
        total = own_mass + mass
        reduced = own_mass * mass / total
        origin.set("xyz", f"{mass * ahead / total!r} 0 {(own_mass * own_height + mass * height) / total!r}")
        mass_element.set("value", repr(total))
        squares = {"ixx": (height - own_height) ** 2, "iyy": (height - own_height) ** 2 + ahead**2, "izz": ahead**2}
        for name, square in squares.items():
            inertia.set(name, repr(float(inertia.attrib[name]) + reduced * square))

    def attach(self, robot: Element) -> None:
        """A point mass on a massless rod, free to swing about the torso."""
        if not self.swing_payload:
            return
        joint = SubElement(robot, "joint", name=PENDULUM, type="revolute")
        SubElement(joint, "limit", lower="-1000", upper="1000", effort="0", velocity="1000")
        SubElement(joint, "parent", link="torso")
        SubElement(joint, "child", link=f"{PENDULUM}_bob")
        SubElement(joint, "origin", xyz=f"0 0 {self.payload_height!r}")
        SubElement(joint, "axis", xyz="0 1 0")
        inertial = SubElement(SubElement(robot, "link", name=f"{PENDULUM}_bob"), "inertial")
        SubElement(inertial, "origin", xyz=f"0 0 {-self.swing_length!r}")
        SubElement(inertial, "mass", value=repr(self.swing_payload))
        small = repr(self.swing_payload * BOB_RADIUS**2)
        SubElement(inertial, "inertia", ixx=small, iyy=small, izz=small, ixy="0", ixz="0", iyz="0")

    def attached_at(self, q: Array, dq: Array, slope: float) -> dict[str, tuple[float, float]]:
        """It hangs along gravity, and does not turn."""
        return {PENDULUM: (slope - q[2], -dq[2])} if self.swing_payload else {}
