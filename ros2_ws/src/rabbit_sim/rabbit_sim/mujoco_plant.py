"""The true plant in MuJoCo: a second engine, whose contacts share no code and no model with PyBullet's.

The hip's three planar joints, the legs and their inertias come from the same perturbed URDF. A foot is a sphere; a
stone is a box. A contact's force and acceleration obey, inside an elliptic friction cone, with the penetration -r,

    r'' + R force = -b r' - k r,    R = 1 / m    where the impedance is 1/2; m: MuJoCo's estimate of the leg's mass

so a resting foot stands on a spring of stiffness m k and damping m b. They are the parameters', but that b is at most
1 / substep: friction has the same b, and would swing with a larger one. (So the damping is 1.3e4 N s/m at
mass scale 1.) MuJoCo's default impedance, near 1, is over a hundred times as stiff: a standing foot sinks by some um,
and lets go where friction carries the leg (Painleve).
"""

from collections.abc import Iterator, Sequence
from functools import lru_cache
from math import hypot
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

import mujoco
import pinocchio
from rabbit_description.planar_urdf import BASE
from rabbit_description.state import DOF, Array, Leg

from rabbit_sim.engine_plant import STONE_DEPTH, EnginePlant, Forces, JointStates
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.plant import FOOT_RADIUS, SUBSTEP_SECONDS, Span, gravity
from rabbit_sim.terrain import KEPT_STONES

IMPEDANCE = (0.5, 0.5, 0.001, 0.5, 2.0)  # 1/2, whatever the penetration
AWAY = -100.0  # m, where unused stones lie
# by its priority the friction and softness of a foot count, not the stone's
FOOT = {"type": "sphere", "priority": "1", "condim": "3", "contype": "1", "conaffinity": "0"}
JOINTS = {"JointModelPX": ("slide", "1 0 0"), "JointModelPZ": ("slide", "0 0 1"), "JointModelRY": ("hinge", "0 1 0")}
FREE = 100.0  # rad or m: a joint with such limits or wider ones has none
FEET = ("left_foot", "right_foot")


class MujocoPlant(EnginePlant):
    """RABBIT in a `model` that is compiled once; the stones are moved and resized."""

    def __init__(self, parameters: SimulationParameters) -> None:
        super().__init__(parameters)
        self.model = mujoco.MjModel.from_xml_string(
            robot_mjcf(self._robot_urdf, parameters.ground_friction, parameters.sole_radius)
        )
        if parameters.coulomb:
            self.model.dof_frictionloss[BASE:DOF] = parameters.coulomb
            self.model.dof_solref[BASE:DOF] = 2 * SUBSTEP_SECONDS, 1.0  # the least there is: it creeps by it at rest
        self.model.opt.gravity[::2] = gravity(parameters.slope)
        self._data = mujoco.MjData(self.model)
        names = [self.model.geom(i).name for i in range(self.model.ngeom)]
        self._torque, self._pressing = self._data.qfrc_applied[BASE:DOF], self._data.sensordata  # views
        self._torso_force = self._data.xfrc_applied[self.model.body("torso").id]
        self._feet_geoms = [names.index(foot) for foot in FEET]
        for foot in self._feet_geoms:
            inverse_mass = self.model.body_invweight0[self.model.geom_bodyid[foot], 0]
            k, b = parameters.ground_stiffness * inverse_mass, parameters.ground_damping * inverse_mass
            b = min(b, 1 / SUBSTEP_SECONDS)
            self.model.geom_solref[foot] = -k / 2, -b / 2  # MuJoCo divides by the impedance
            self.model.geom_solimp[foot] = IMPEDANCE
        stones = slice(names.index("stone_0"), names.index("stone_0") + KEPT_STONES)
        self._stone_sizes, self._stone_boxes = self.model.geom_size[stones], self.model.geom_aabb[stones, 3:]  # views
        self._stone_reaches, first = self.model.geom_rbound[stones], self.model.geom_bodyid[stones.start]
        self._stone_places = self.model.body_pos[first : first + KEPT_STONES]

    def walk(self, torques: Array, pushes: list[float], path: Array, sensed: Array) -> None:
        """Walk a tick under the motors' `torques` (substeps, 4), and leave it to `follow` to take in what came of it.

        Writes q and dq after each substep into `path` (substeps, 14), the feet's forces into `sensed` (substeps, 6).
        """
        for substep, _ in enumerate(self._walked(torques, pushes)):
            path[substep, :DOF], path[substep, DOF:] = self._data.qpos[:DOF], self._data.qvel[:DOF]
            sensed[substep] = self._pressing

    def _walked(self, torques: Array, pushes: list[float]) -> Iterator[Forces]:
        """Solves each tick's contacts from nothing, as `mujoco.rollout` does for a batch of robots."""
        self._data.qacc_warmstart[:] = 0.0
        self._states = None  # `follow` may have left one
        return super()._walked(torques, pushes)

    def set_friction(self, leg: Leg, coefficient: float) -> None:
        self.model.geom_friction[self._feet_geoms[leg], 0] = coefficient

    def _make_world(self, q: Array, dq: Array) -> None:
        self.model.geom_friction[self._feet_geoms, 0] = self._parameters.ground_friction
        mujoco.mj_resetData(self.model, self._data)
        self._data.qpos[:DOF], self._data.qvel[:DOF] = q, dq
        for name, (angle, rate) in self._attached_at(q, dq).items():
            self._data.joint(name).qpos[:], self._data.joint(name).qvel[:] = angle, rate
        self._place([])

    def _place(self, spans: Sequence[Span]) -> None:
        """Place and resize boxes; those that are not needed lie far away."""
        placed = [*spans, *[Span(AWAY, AWAY)] * (KEPT_STONES - len(spans))]
        halves = [((far - near) / 2 + FOOT_RADIUS, 0.5, STONE_DEPTH / 2) for near, far, _ in placed]
        self._stone_sizes[:] = self._stone_boxes[:] = halves
        self._stone_reaches[:] = [hypot(*half) for half in halves]
        places = [((near + far) / 2, 0.0, top - FOOT_RADIUS - STONE_DEPTH / 2) for near, far, top in placed]
        self._stone_places[:] = self._data.mocap_pos[:] = places

    def _substep(self, torque: list[float], push: float = 0.0) -> None:
        self._torque[:] = torque
        self._torso_force[0] = push
        mujoco.mj_step(self.model, self._data)

    def _joint_states(self) -> JointStates:
        return self._data.qpos[:DOF].tolist(), self._data.qvel[:DOF].tolist()

    def _contact_forces(self) -> Forces:
        left_x, _, left_z, right_x, _, right_z = self._pressing.tolist()
        return [[-left_x, -left_z], [-right_x, -right_z]]


@lru_cache(maxsize=64)
def robot_mjcf(urdf: str, friction: float, radius: float = FOOT_RADIUS) -> str:
    """MuJoCo's XML of a planar robot, its feet as spheres of `radius`, m, and `KEPT_STONES` boxes to place."""
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
        joint = SubElement(bodies[j], "joint", name=model.names[j], type=kind, axis=axis)
        if (stop := float(model.upperPositionLimit[model.idx_qs[j]])) < FREE:
            joint.attrib |= {"range": f"{-stop!r} {stop!r}", "solreflimit": f"{2 * SUBSTEP_SECONDS!r} 1"}
        inertia = model.inertias[j]
        if inertia.mass > 0:
            diagonal = text(inertia.inertia.diagonal())
            SubElement(bodies[j], "inertial", pos=text(inertia.lever), mass=repr(inertia.mass), diaginertia=diagonal)
    sensors = SubElement(scene, "sensor")
    for foot in FEET:
        SubElement(sensors, "contact", geom1=foot, data="force", reduce="netforce")  # the foot's on stones
        frame = model.frames[model.getFrameId(foot)]
        at, rubber = text(frame.placement.translation + (0.0, 0.0, radius - FOOT_RADIUS)), f"{friction!r} 0 0"
        SubElement(bodies[frame.parentJoint], "geom", FOOT, name=foot, size=repr(radius), pos=at, friction=rubber)
    return ElementTree.tostring(scene, encoding="unicode")


def text(numbers: Array) -> str:
    """The numbers as MuJoCo reads them, with all digits."""
    return " ".join(map(repr, numbers.tolist()))
