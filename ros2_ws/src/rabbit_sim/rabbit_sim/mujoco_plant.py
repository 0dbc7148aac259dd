"""The true plant in MuJoCo: a second engine, whose contacts share no code and no model with PyBullet's.

The hip's three planar joints, the legs and their inertias come from the same perturbed URDF. A foot is a sphere; a
stone is a box. MuJoCo lets the contact point accelerate as a damped spring on the penetration r would,

    r'' = -2 r' / T - r / (T zeta)^2,    T = CONTACT_TIME, zeta = CONTACT_DAMPING_RATIO,

within an elliptic friction cone. At a leg of apparent mass m that is a spring of stiffness m / (T zeta)^2 and damping
2 m / T. With m = 22 kg at mass scale 1 and 43 kg at 2 (medians of walks) these are 0.6e6 and 1.2e6 N/m, 2.2e4 and
4.3e4 N s/m: about the rubber of `pybullet_plant.py`, which a foot needs here too. With zeta = 1, MuJoCo's default, a
standing foot sinks by some um and lets go where friction carries the leg (Painleve).
"""

from collections.abc import Sequence
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import mujoco
import numpy as np
import pinocchio
from rabbit_description.state import Array, Leg

from rabbit_sim.actuation import Actuation, JointDamping
from rabbit_sim.kinematics import RabbitFeet
from rabbit_sim.parameters import SUBSTEP_SECONDS, SimulationParameters
from rabbit_sim.plant import CONTACT_FORCE, SUBSTEPS, PlantReading, Span
from rabbit_sim.robot_urdf import perturbed_urdf
from rabbit_sim.terrain import KEPT_STONES
from rabbit_sim.touchdown_detector import TouchdownDetector

FOOT_RADIUS = 0.002  # m, of the URDF's foot sphere: a foot's centre at z = 0 stands on a top at -FOOT_RADIUS
STONE_DEPTH = 1.0  # m
CONTACT_TIME, CONTACT_DAMPING_RATIO = 0.002, 3.0  # s, two substeps at least; 1
AWAY = -100.0  # m, where unused stones lie
FOOT = {  # its friction and softness count, not the stone's
    "type": "sphere",
    "size": repr(FOOT_RADIUS),
    "priority": "1",
    "condim": "3",
    "solref": f"{CONTACT_TIME} {CONTACT_DAMPING_RATIO}",
    "solimp": "0.99 0.99 0.001",
    "contype": "1",
    "conaffinity": "0",
}
JOINTS = {"JointModelPX": ("slide", "1 0 0"), "JointModelPZ": ("slide", "0 0 1"), "JointModelRY": ("hinge", "0 1 0")}
FEET = ("left_foot", "right_foot")


class MujocoPlant:
    """RABBIT on boxes. See `Plant` for the methods."""

    def __init__(self, parameters: SimulationParameters) -> None:
        self._kinematics = RabbitFeet(parameters.link_bend)
        urdf = perturbed_urdf(parameters)
        self._model = mujoco.MjModel.from_xml_string(robot_mjcf(urdf, parameters.ground_friction))
        self._data = mujoco.MjData(self._model)
        self._actuation = Actuation(parameters)
        self._damping = JointDamping(urdf, parameters.joint_damping) if parameters.joint_damping else None
        names = [self._model.geom(i).name for i in range(self._model.ngeom)]
        self._foot_of_geom = {names.index(foot): leg for foot, leg in zip(FEET, Leg, strict=True)}
        self._stone_geoms = [i for i, name in enumerate(names) if name.startswith("stone")]

    def close(self) -> None:
        """Nothing to give back."""

    def reset(self, q: Array, dq: Array, stance: Leg) -> None:
        """A new world, so that nothing (motors, warm starts, stones) is left of the last episode."""
        mujoco.mj_resetData(self._model, self._data)
        self._data.qpos, self._data.qvel = q, dq
        self._actuation.reset()
        self.set_stones([])
        self._force = np.zeros((2, 2))
        self._contact = np.array([stance is Leg.LEFT, stance is Leg.RIGHT])
        self._watch = TouchdownDetector(self._locate_feet)

    def set_stones(self, spans: Sequence[Span]) -> None:
        """Have exactly these boxes. Wider by the foot's radius, so that a foot's centre on the edge still stands."""
        for i, geom in enumerate(self._stone_geoms):
            near, far = spans[i] if i < len(spans) else (AWAY, AWAY)
            half = np.array([(far - near) / 2 + FOOT_RADIUS, 0.5, STONE_DEPTH / 2])
            self._model.geom_size[geom], self._model.geom_aabb[geom, 3:] = half, half
            self._model.geom_rbound[geom] = np.linalg.norm(half)
            self._data.mocap_pos[i] = (near + far) / 2, 0.0, -FOOT_RADIUS - STONE_DEPTH / 2

    def advance(self, command: Array) -> None:
        """Ten substeps, each under its torque."""
        self._watch.begin_tick(self._locate_feet())
        forces = []
        for torque in self._actuation.advance(command):
            self._data.qfrc_applied[3:] = self.damped(torque)
            mujoco.mj_step(self._model, self._data)
            forces.append(self._contact_forces())
            self._watch.substep(forces[-1])
        self._force = np.add.reduce(forces) / SUBSTEPS
        self._contact = np.maximum.reduce(forces)[:, 1] > CONTACT_FORCE  # at any moment: a foot may bounce within it

    def damped(self, torque: Array) -> Array:
        """`torque` (4,) of the motors with the joints' damping at the present state, N m."""
        return torque + self._damping.torque(self._data.qpos, self._data.qvel) if self._damping else torque

    def observe(self) -> PlantReading:
        """The truth after the last tick."""
        q, dq = self._data.qpos.copy(), self._data.qvel.copy()
        return PlantReading(q, dq, self._force, self._locate_feet(), self._contact, tuple(self._watch.touches))

    def _locate_feet(self) -> Array:
        return self._kinematics.positions(self._data.qpos)

    def _contact_forces(self) -> list[list[float]]:
        """Force on each foot in the last substep, rows left, right; columns x, z; N."""
        force = [[0.0, 0.0], [0.0, 0.0]]
        contact = self._data.contact
        for (geom, _), frame, start in zip(contact.geom, contact.frame, contact.efc_address, strict=True):
            if start >= 0:  # a sphere comes before a box, and the force is that on the box
                on_stone = self._data.efc_force[start : start + 3] @ frame.reshape(3, 3)
                foot = force[self._foot_of_geom[geom]]
                foot[0] -= on_stone[0]
                foot[1] -= on_stone[2]
        return force


def robot_mjcf(urdf: str, friction: float) -> str:
    """MuJoCo's XML of a planar robot, its feet as spheres, and `KEPT_STONES` boxes to place."""
    model = pinocchio.buildModelFromXML(urdf)
    scene = Element("mujoco")
    SubElement(scene, "compiler", angle="radian", balanceinertia="false")
    option = SubElement(scene, "option", timestep=repr(SUBSTEP_SECONDS), cone="elliptic", impratio="100")
    SubElement(option, "flag", midphase="disable")  # it would know the boxes by the size that they are made with
    world = SubElement(scene, "worldbody")
    for i in range(KEPT_STONES):
        stone = SubElement(world, "body", name=f"stone_{i}", mocap="true")
        SubElement(stone, "geom", name=f"stone_{i}", type="box", size="1 1 1", contype="0", conaffinity="1")
    torso = SubElement(world, "body", name="torso")
    bodies = [world, torso, torso, torso]  # by joint: the base's three move one body
    for j in range(1, model.njoints):
        if j == len(bodies):
            at = model.jointPlacements[j].translation
            bodies.append(SubElement(bodies[model.parents[j]], "body", name=model.names[j], pos=text(at)))
        kind, axis = JOINTS[model.joints[j].shortname()]
        SubElement(bodies[j], "joint", name=model.names[j], type=kind, axis=axis)
        inertia = model.inertias[j]
        if inertia.mass > 0:
            diagonal = text(inertia.inertia.diagonal())
            SubElement(bodies[j], "inertial", pos=text(inertia.lever), mass=repr(inertia.mass), diaginertia=diagonal)
    for foot in FEET:
        frame = model.frames[model.getFrameId(foot)]
        at, rubber = text(frame.placement.translation), f"{friction!r} 0 0"
        SubElement(bodies[frame.parentJoint], "geom", FOOT, name=foot, pos=at, friction=rubber)
    return ElementTree.tostring(scene, encoding="unicode")


def text(numbers: Array) -> str:
    """As MuJoCo reads them, with all digits."""
    return " ".join(map(repr, numbers.tolist()))
