"""The true plant in PyBullet: contacts, friction and real stones with gaps."""

import locale
import os
import sys
from collections.abc import Collection, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import Any

from rabbit_description.state import ACTUATED, COORDINATES, Array, Leg

from rabbit_sim.engine_plant import STONE_DEPTH, EnginePlant, JointStates
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.plant import FOOT_RADIUS, SUBSTEP_SECONDS, Span, gravity

STDERR = 2  # of the process, where C code writes: PyBullet prints a line, many processes into a progress bar

sys.stderr.flush()
_kept, _nowhere = os.dup(STDERR), os.open(os.devnull, os.O_WRONLY)
os.dup2(_nowhere, STDERR)
try:
    import pybullet
finally:
    os.dup2(_kept, STDERR)
    os.close(_kept)
    os.close(_nowhere)

SOLVER_ITERATIONS = 50
ERP = 0.1  # share of a contact's or joint's position error mended per substep


class PhysicsClient:
    """PyBullet's functions in a physics world of one's own, without graphics. (`pybullet_utils`' own client prints.)"""

    def __init__(self) -> None:
        self._client: int = pybullet.connect(pybullet.DIRECT)

    def __getattr__(self, name: str) -> Any:
        function = partial(getattr(pybullet, name), physicsClientId=self._client)
        setattr(self, name, function)  # the next call finds it
        return function


class PybulletPlant(EnginePlant):
    """RABBIT in a `PhysicsClient`."""

    def __init__(self, parameters: SimulationParameters) -> None:
        super().__init__(parameters)
        # PyBullet reads files alone; this one is in memory, and is gone with the process, however that ends
        self._file = os.fdopen(os.memfd_create("rabbit.urdf"), "w", encoding="utf-8")
        self._file.write(self._robot_urdf)
        self._file.flush()
        self._client = PhysicsClient()

    def close(self) -> None:
        """Disconnect; twice does no harm."""
        super().close()
        if self._client.isConnected():
            self._client.disconnect()
            self._file.close()

    def _make_world(self, q: Array, dq: Array) -> None:
        self._client.resetSimulation()
        along, normal = gravity(self._parameters.slope)
        self._client.setGravity(along, 0, normal)
        self._client.setTimeStep(SUBSTEP_SECONDS)
        self._client.setPhysicsEngineParameter(
            numSolverIterations=SOLVER_ITERATIONS, numSubSteps=0, erp=ERP, contactERP=ERP, enableFileCaching=0
        )
        attached = self._attached_at(q, dq)
        index = self._load_robot(attached)
        for joint, position, velocity in zip(self._joints, q.tolist(), dq.tolist(), strict=True):
            self._client.resetJointState(self._robot, joint, position, velocity)
        for name, state in attached.items():
            self._client.resetJointState(self._robot, index[name], *state)
        self._stones: dict[Span, int] = {}

    def _load_robot(self, attached: Collection[str]) -> dict[str, int]:
        """Returns PyBullet's number of each joint by name; those in `attached` have no motor."""
        with decimal_points():
            self._robot: int = self._client.loadURDF(
                f"/proc/self/fd/{self._file.fileno()}", useFixedBase=True, flags=pybullet.URDF_USE_INERTIA_FROM_FILE
            )
        infos = [self._client.getJointInfo(self._robot, j) for j in range(self._client.getNumJoints(self._robot))]
        index = {info[1].decode(): info[0] for info in infos}
        self._joints = [index[name] for name in COORDINATES]
        self._torso = index["base_pitch"]  # a link has its joint's number
        self._motors = [index[name] for name in ACTUATED]
        self._feet_links = [index["left_ankle"], index["right_ankle"]]
        free = [*self._joints, *(index[name] for name in attached)]  # no motor of PyBullet's own
        self._client.setJointMotorControlArray(self._robot, free, pybullet.VELOCITY_CONTROL, forces=[0.0] * len(free))
        for link in range(-1, len(infos)):  # one change a call: PyBullet drops some when several come together
            self._client.changeDynamics(self._robot, link, linearDamping=0.0)
            self._client.changeDynamics(self._robot, link, angularDamping=0.0)
            self._client.changeDynamics(self._robot, link, jointDamping=0.0)
        for link in self._feet_links:
            self._set_surface(self._robot, link, self._parameters.ground_friction)
            stiffness, damping = self._parameters.ground_stiffness, self._parameters.ground_damping
            self._client.changeDynamics(self._robot, link, contactStiffness=stiffness, contactDamping=damping)
        if friction := self._parameters.coulomb:  # a motor that holds still, as strong as the friction
            self._client.setJointMotorControlArray(
                self._robot, self._motors, pybullet.VELOCITY_CONTROL, forces=[friction] * len(self._motors)
            )
        return index

    def set_friction(self, leg: Leg, coefficient: float) -> None:
        self._set_surface(self._robot, self._feet_links[leg], coefficient)

    def _set_surface(self, body: int, link: int, friction: float) -> None:
        """PyBullet multiplies the friction of the two bodies, so a stone's is 1."""
        self._client.changeDynamics(body, link, lateralFriction=friction)
        self._client.changeDynamics(body, link, restitution=0.0)
        info = self._client.getDynamicsInfo(body, link)
        if info[1] != friction or info[5] != 0.0:
            raise RuntimeError(f"PyBullet kept friction {info[1]}, restitution {info[5]}: expected {friction}, 0")

    def _place(self, spans: Sequence[Span]) -> None:
        for span in set(self._stones) - set(spans):
            self._client.removeBody(self._stones.pop(span))
        for span in spans:
            if span not in self._stones:
                self._stones[span] = self._add_box(span)

    def _add_box(self, span: Span) -> int:
        near, far, top = span
        half = [(far - near) / 2 + FOOT_RADIUS, 0.5, STONE_DEPTH / 2]
        shape = self._client.createCollisionShape(pybullet.GEOM_BOX, halfExtents=half)
        centre = [(near + far) / 2, 0.0, top - FOOT_RADIUS - STONE_DEPTH / 2]
        body: int = self._client.createMultiBody(0, shape, basePosition=centre)
        self._set_surface(body, -1, 1.0)
        return body

    def _substep(self, torque: list[float], push: float = 0.0) -> None:
        self._apply(torque)
        if push:
            centre = self._client.getLinkState(self._robot, self._torso)[0]
            self._client.applyExternalForce(self._robot, self._torso, [push, 0, 0], centre, pybullet.WORLD_FRAME)
        self._client.stepSimulation()

    def _apply(self, torque: Sequence[float]) -> None:
        """Applies the torques for the next substep alone, as PyBullet forgets them."""
        self._client.setJointMotorControlArray(self._robot, self._motors, pybullet.TORQUE_CONTROL, forces=torque)

    def _joint_states(self) -> JointStates:
        states: Any = self._client.getJointStates(self._robot, self._joints)
        return [s[0] for s in states], [s[1] for s in states]

    def _contact_forces(self) -> list[list[float]]:
        force = [[0.0, 0.0], [0.0, 0.0]]
        for point in self._client.getContactPoints(bodyA=self._robot):
            foot = force[self._feet_links.index(point[3])]
            normal, first, second = point[7], point[11], point[13]
            foot[0] += point[9] * normal[0] + point[10] * first[0] + point[12] * second[0]
            foot[1] += point[9] * normal[2] + point[10] * first[2] + point[12] * second[2]
        return force


@contextmanager
def decimal_points() -> Iterator[None]:
    """PyBullet reads numbers by the locale of the process: under one with a decimal comma it takes 4.384 kg for 4."""
    usual = locale.setlocale(locale.LC_NUMERIC)
    locale.setlocale(locale.LC_NUMERIC, "C")
    try:
        yield
    finally:
        locale.setlocale(locale.LC_NUMERIC, usual)
