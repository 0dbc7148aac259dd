"""The true plant in PyBullet: contacts, friction and real stones with gaps."""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rabbit_description.state import ACTUATED, COORDINATES, Array, Leg

from rabbit_sim.actuation import Actuation, JointDamping
from rabbit_sim.kinematics import RabbitFeet
from rabbit_sim.parameters import SUBSTEP_SECONDS, SimulationParameters
from rabbit_sim.plant import CONTACT_FORCE, SUBSTEPS, PlantReading, Span
from rabbit_sim.quiet_pybullet import pybullet
from rabbit_sim.robot_urdf import perturbed_urdf
from rabbit_sim.touchdown_detector import TouchdownDetector

GRAVITY = 9.81
SOLVER_ITERATIONS = 50
ERP = 0.1  # share of a contact's or joint's position error mended per substep
# A foot's rubber. A rigid contact has two answers where friction carries the leg (Painleve): the engine's iteration
# starts at no force and may stay there, so a standing foot lets go. Compliance leaves the one that presses.
CONTACT_STIFFNESS = 1e6  # N/m
CONTACT_DAMPING = 3e4  # N s/m; impacts are inelastic: with less the rubber throws the foot back
FOOT_RADIUS = 0.002  # m, of the URDF's foot sphere: a foot's centre at z = 0 stands on a top at -FOOT_RADIUS
STONE_DEPTH = 1.0  # m


class PybulletPlant:
    """RABBIT in a physics client of its own, without graphics. See `Plant` for the methods."""

    def __init__(self, parameters: SimulationParameters) -> None:
        self._parameters = parameters
        self._actuation = Actuation(parameters)
        self._kinematics = RabbitFeet(parameters.link_bend)
        urdf = perturbed_urdf(parameters)
        self._damping = JointDamping(urdf, parameters.joint_damping) if parameters.joint_damping else None
        self._folder = tempfile.TemporaryDirectory(prefix="rabbit_sim_")
        self._urdf = Path(self._folder.name) / "rabbit.urdf"
        self._urdf.write_text(urdf, encoding="utf-8")
        self._client: int = pybullet.connect(pybullet.DIRECT)

    def close(self) -> None:
        """Disconnect; twice does no harm."""
        if self._client >= 0:
            pybullet.disconnect(physicsClientId=self._client)
            self._client = -1
            self._folder.cleanup()

    def reset(self, q: Array, dq: Array, stance: Leg) -> None:
        """A new world, so that nothing (motors, warm starts, stones) is left of the last episode."""
        pybullet.resetSimulation(physicsClientId=self._client)
        self._configure_engine()
        self._load_robot()
        for joint, position, velocity in zip(self._joints, q.tolist(), dq.tolist(), strict=True):
            pybullet.resetJointState(self._robot, joint, position, velocity, physicsClientId=self._client)
        self._actuation.reset()
        self._stones: dict[Span, int] = {}
        self._q, self._dq = q.copy(), dq.copy()
        self._force = np.zeros((2, 2))
        self._contact = np.array([stance is Leg.LEFT, stance is Leg.RIGHT])
        self._feet = self._locate_feet()
        self._watch = TouchdownDetector(self._locate_feet)

    def _configure_engine(self) -> None:
        client = self._client
        pybullet.setGravity(0, 0, -GRAVITY, physicsClientId=client)
        pybullet.setTimeStep(SUBSTEP_SECONDS, physicsClientId=client)
        pybullet.setPhysicsEngineParameter(
            numSolverIterations=SOLVER_ITERATIONS,
            numSubSteps=0,
            erp=ERP,
            contactERP=ERP,
            enableFileCaching=0,
            physicsClientId=client,
        )

    def _load_robot(self) -> None:
        client = self._client
        self._robot: int = pybullet.loadURDF(
            str(self._urdf), useFixedBase=True, flags=pybullet.URDF_USE_INERTIA_FROM_FILE, physicsClientId=client
        )
        infos = [
            pybullet.getJointInfo(self._robot, j, physicsClientId=client)
            for j in range(pybullet.getNumJoints(self._robot, physicsClientId=client))
        ]
        index = {info[1].decode(): info[0] for info in infos}
        self._joints = [index[name] for name in COORDINATES]
        self._motors = [index[name] for name in ACTUATED]
        self._foot_of_link = {index["left_ankle"]: Leg.LEFT, index["right_ankle"]: Leg.RIGHT}
        pybullet.setJointMotorControlArray(
            self._robot, self._joints, pybullet.VELOCITY_CONTROL, forces=[0.0] * 7, physicsClientId=client
        )
        for link in range(-1, len(infos)):
            self._change_dynamics(self._robot, link, linearDamping=0.0)
            self._change_dynamics(self._robot, link, angularDamping=0.0)
            self._change_dynamics(self._robot, link, jointDamping=0.0)
        for link in self._foot_of_link:
            self._set_surface(self._robot, link, self._parameters.ground_friction)
            self._change_dynamics(self._robot, link, contactStiffness=CONTACT_STIFFNESS, contactDamping=CONTACT_DAMPING)

    def _change_dynamics(self, body: int, link: int, **change: float) -> None:
        """One change a call, but stiffness with damping: PyBullet drops some of them when several come together."""
        pybullet.changeDynamics(body, link, physicsClientId=self._client, **change)

    def _set_surface(self, body: int, link: int, friction: float) -> None:
        """PyBullet multiplies the friction of the two bodies, so a stone's is 1."""
        self._change_dynamics(body, link, lateralFriction=friction)
        self._change_dynamics(body, link, restitution=0.0)
        info = pybullet.getDynamicsInfo(body, link, physicsClientId=self._client)
        if info[1] != friction or info[5] != 0.0:
            raise RuntimeError(f"PyBullet kept friction {info[1]}, restitution {info[5]}: expected {friction}, 0")

    def set_stones(self, spans: Sequence[Span]) -> None:
        """Have exactly these boxes. Wider by the foot's radius, so that a foot's centre on the edge still stands."""
        for span in set(self._stones) - set(spans):
            pybullet.removeBody(self._stones.pop(span), physicsClientId=self._client)
        for span in spans:
            if span not in self._stones:
                self._stones[span] = self._add_box(*span)

    def _add_box(self, near: float, far: float) -> int:
        half = [(far - near) / 2 + FOOT_RADIUS, 0.5, STONE_DEPTH / 2]
        shape = pybullet.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half, physicsClientId=self._client)
        centre = [(near + far) / 2, 0.0, -FOOT_RADIUS - STONE_DEPTH / 2]
        body: int = pybullet.createMultiBody(0, shape, basePosition=centre, physicsClientId=self._client)
        self._set_surface(body, -1, 1.0)
        return body

    def advance(self, command: Array) -> None:
        """Ten substeps; the torque is given anew at each, as PyBullet forgets it."""
        self._watch.begin_tick(self._feet)
        impulse, peak = np.zeros((2, 2)), np.zeros((2, 2))
        for torque in self._actuation.advance(command):
            self._apply(torque)
            pybullet.stepSimulation(physicsClientId=self._client)
            force = self._contact_forces()
            self._watch.substep(force)
            impulse += force
            peak = np.maximum(peak, force)
        self._force = impulse / SUBSTEPS
        self._contact = peak[:, 1] > CONTACT_FORCE  # at any moment of the tick: a foot may bounce within it
        self._q, self._dq = self._joint_states()
        self._feet = self._kinematics.positions(self._q)

    def observe(self) -> PlantReading:
        """The truth after the last tick."""
        return PlantReading(self._q, self._dq, self._force, self._feet, self._contact, tuple(self._watch.touches))

    def _locate_feet(self) -> Array:
        return self._kinematics.positions(self._joint_states()[0])

    def _apply(self, torque: Array) -> None:
        if self._damping is not None:
            torque = torque + self._damping.torque(*self._joint_states())
        pybullet.setJointMotorControlArray(
            self._robot, self._motors, pybullet.TORQUE_CONTROL, forces=torque.tolist(), physicsClientId=self._client
        )

    def _joint_states(self) -> tuple[Array, Array]:
        states: Any = pybullet.getJointStates(self._robot, self._joints, physicsClientId=self._client)
        return np.array([s[0] for s in states]), np.array([s[1] for s in states])

    def _contact_forces(self) -> list[list[float]]:
        """Force on each foot in the last substep, rows left, right; columns x, z; N."""
        force = [[0.0, 0.0], [0.0, 0.0]]
        for point in pybullet.getContactPoints(bodyA=self._robot, physicsClientId=self._client):
            foot = force[self._foot_of_link[point[3]]]
            normal, first, second = point[7], point[11], point[13]
            foot[0] += point[9] * normal[0] + point[10] * first[0] + point[12] * second[0]
            foot[1] += point[9] * normal[2] + point[10] * first[2] + point[12] * second[2]
        return force
