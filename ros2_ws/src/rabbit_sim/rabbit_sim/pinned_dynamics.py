"""The paper's hybrid model of a planar robot with two point feet.

In stance, the foot pinned:   M ddq + h = B tau + J' F,   J ddq + dJ/dt dq = 0
At impact of the other foot:  M (dq+ - dq-) = J' L,       J dq+ = 0

M mass matrix, h bias forces, B tau joint torques on the coordinates after the base's three, J Jacobian (2, n) of the
pinned foot, F its ground force, L its impulse (both x, z). Inelastic impact, no slip, the old stance foot free at once
(Grizzle, Abba, Plestan 2001). In stance the robot is a tree that grows from its foot (`PinnedChain`), which knows no F;
the first two rows of M ddq + h, those of the base's slides, are F.
"""

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
import pinocchio
from rabbit_description.planar_urdf import BASE, BASE_JOINTS, SLIDES, UrdfError
from rabbit_description.state import Array, Leg

from rabbit_sim.perturbation import JointTorque
from rabbit_sim.plant import gravity

PLANE = [0, 2]  # x and z of a spatial vector
OUT_OF_PLANE = [1, 3, 5]  # y, and the turns about x and z
BASE_JOINT = BASE  # pinocchio's number of the base's pitch
PITCH = "JointModelRY"


class Feet(Protocol):
    """Where the two feet of a robot with n coordinates are, world frame, columns or entries x, z; m."""

    links: tuple[str, str]  # of the URDF, left and right, in whose origins the feet are

    def positions(self, q: Array) -> Array:
        """Of both, shape (2, 2): rows left, right."""

    def points(self, q: Sequence[float]) -> Sequence[Sequence[float]]:
        """The same of plain numbers."""

    def jacobian(self, q: Array, leg: Leg) -> Array:
        """Foot velocity over `dq`, shape (2, n)."""


class UrdfFeet:
    """The origins of two links of a planar robot.

    Raises:
        UrdfError: a link that is not there, or a robot that does not move in the plane alone.
    """

    def __init__(self, urdf: str, links: tuple[str, str] = ("left_foot", "right_foot")) -> None:
        self._model = planar_model(urdf)
        self._data = self._model.createData()
        missing = [link for link in links if not self._model.existFrame(link)]
        if missing:
            raise UrdfError(f"URDF {self._model.name}: no link {', '.join(missing)} for a foot")
        self.links = links
        self._frames = [self._model.getFrameId(link) for link in links]

    def positions(self, q: Array) -> Array:
        """Of both, shape (2, 2): rows left, right."""
        pinocchio.framesForwardKinematics(self._model, self._data, q)
        return np.array([self._data.oMf[frame].translation[PLANE] for frame in self._frames])

    def points(self, q: Sequence[float]) -> Sequence[Sequence[float]]:
        """The same of plain numbers."""
        points: list[list[float]] = self.positions(np.array(q)).tolist()
        return points

    def jacobian(self, q: Array, leg: Leg) -> Array:
        """Foot velocity over `dq`, shape (2, n)."""
        world = pinocchio.LOCAL_WORLD_ALIGNED
        return pinocchio.computeFrameJacobian(self._model, self._data, q, self._frames[leg], world)[PLANE]


def standing(feet: Feet, q: Array, dq: Array, leg: Leg) -> tuple[Array, Array]:
    """The same posture and rates, each (n,), with the base moved so that a foot is at rest at the origin."""
    q, dq = q.copy(), dq.copy()
    q[:2] -= feet.positions(q)[leg]
    dq[:2] -= feet.jacobian(q, leg) @ dq
    return q, dq


def planar_model(urdf: str) -> pinocchio.Model:
    """The model of a robot whose first coordinates are those of `BASE_JOINTS`, and which moves in the x-z plane alone.

    Raises:
        UrdfError: another base, or a joint that leaves the plane; names it.
    """
    model = pinocchio.buildModelFromXML(urdf)
    names = list(model.names)[1:]
    if tuple(names[:BASE]) != BASE_JOINTS or model.nq != model.nv:
        raise UrdfError(f"URDF {model.name}: joints {names}; expected {', '.join(BASE_JOINTS)} first, then single axes")
    data, q = model.createData(), np.linspace(0.1, 1.0, model.nq)
    pinocchio.computeJointJacobians(model, data, q)
    for joint, name in enumerate(names, start=1):
        jacobian = pinocchio.getJointJacobian(model, data, joint, pinocchio.LOCAL_WORLD_ALIGNED)
        if np.abs(jacobian[OUT_OF_PLANE]).max() > 1e-9:
            raise UrdfError(f"URDF {model.name}: joint {name} leaves the x-z plane; expected axes along y, or x and z")
    return model


class PinnedDynamics:
    """Of the robot that `urdf` describes, its feet where `feet` says.

    `beside`: torques (n - 3,), N m, of q and dq (n,), that act beside the motors' in each joint, such as damping.
    `slope`: rise of the ground, in whose frame all is, degrees. `weight` (2,): what the ground carries at rest, N.
    `chains`: the robot grown from its left and from its right foot; `model`, `data`: pinocchio's of the whole robot.
    """

    def __init__(self, urdf: str, feet: Feet, beside: Sequence[JointTorque] = (), slope: float = 0.0) -> None:
        self.feet = feet
        self.model = planar_model(urdf)
        self.model.gravity.linear[PLANE] = gravity(slope)
        self.data = self.model.createData()
        self._beside = beside
        self.coordinates: int = self.model.nv
        self.inputs = self.coordinates - BASE
        self.chains = [PinnedChain(self.model, self.model.getFrameId(link)) for link in feet.links]
        self.weight = pinocchio.computeTotalMass(self.model) * -np.array(gravity(slope))

    def in_chain(self, stance: Leg, torque: Array) -> Callable[[Array, Array], Array]:
        """z-ddot of the stance foot's chain as a function of z and z-dot, under joint torques (n - 3,), N m."""
        chain = self.chains[stance]
        if not self._beside:
            forces = chain.forces(torque)
            return lambda z, dz: chain.acceleration(z, dz, forces)
        q, dq = np.zeros((2, self.coordinates))

        def acceleration(z: Array, dz: Array) -> Array:
            q[SLIDES:], dq[SLIDES:] = chain.out @ z, chain.out @ dz
            at_joints = sum((each(q, dq) for each in self._beside), torque)
            return chain.acceleration(z, dz, chain.forces(at_joints))

        return acceleration

    def momentum(self, q: Array, dq: Array) -> Array:
        """Linear, x and z, N s."""
        momentum: Array = pinocchio.computeCentroidalMomentum(self.model, self.data, q, dq).linear[PLANE]
        return momentum

    def impact(self, q: Array, dq: Array, landing: Leg) -> tuple[Array, Array]:
        """`dq` (n,) after the foot `landing` has come to rest, and the impulse (2,) on it, x and z, N s."""
        n, mass, jacobian = self.coordinates, pinocchio.crba(self.model, self.data, q), self.feet.jacobian(q, landing)
        system = np.block([[mass, jacobian.T], [jacobian, np.zeros((2, 2))]])  # the second unknown is minus the impulse
        solution = np.linalg.solve(system, np.append(mass @ dq, [0.0, 0.0]))
        return solution[:n], -solution[n:]


class PinnedChain:
    """A planar `model` as a tree that grows from its pinned frame `foot` (its number): no base, slides or constraint.

    Its k = n - 2 coordinates z are the absolute angle of the pinned foot's link, then the joints from that foot to the
    base, passed backwards and so with the other sign, then all other joints: z = C q_r, where q_r is q without the
    base's two slides. `into` (k, k) is C, `out` its inverse.

    Raises:
        UrdfError: the base's slides carry a mass.
    """

    def __init__(self, model: pinocchio.Model, foot: int) -> None:
        if any(model.inertias[joint].mass for joint in range(1, BASE_JOINT)):
            raise UrdfError(f"URDF {model.name}: expected massless slides {', '.join(BASE_JOINTS[:SLIDES])}")
        self._model, self.into = _grown_from(model, foot)
        self._data = self._model.createData()
        self.out: Array = np.linalg.inv(self.into)
        self._drives: Array = self.out[1:].copy()  # power is the same: from torques (k - 1,) on q_r to forces on z

    def forces(self, torques: Array) -> Array:
        """Generalised forces on z (k,) of joint torques (k - 1,), N m."""
        forces: Array = torques.dot(self._drives)
        return forces

    def acceleration(self, z: Array, dz: Array, forces: Array) -> Array:
        """z-ddot (k,)."""
        ddz: Array = pinocchio.aba(self._model, self._data, z, dz, forces)
        return ddz


def _grown_from(model: pinocchio.Model, foot: int) -> tuple[pinocchio.Model, Array]:
    """The tree, and C."""
    coordinates = model.nq - SLIDES
    tree, into = pinocchio.Model(), np.zeros((coordinates, coordinates))
    tree.gravity = model.gravity
    data = model.createData()
    pinocchio.framesForwardKinematics(model, data, np.zeros(model.nq))
    upright = pinocchio.SE3(data.oMf[foot].rotation, np.zeros(3))
    carrier = model.frames[foot].parentJoint
    way = [joint for joint in model.supports[carrier] if joint > BASE_JOINT][::-1]

    root = tree.addJoint(0, pinocchio.JointModelRY(), pinocchio.SE3.Identity(), "foot")
    turning = [joint for joint in [BASE_JOINT, *way] if model.joints[joint].shortname() == PITCH]
    into[0, [model.joints[joint].idx_q - SLIDES for joint in turning]] = 1.0
    bodies = {carrier: (root, upright * model.frames[foot].placement.inverse())}  # by the model's joint: joint, place
    for joint in way:
        parent, place = bodies[joint]
        moved = tree.addJoint(parent, model.joints[joint], place, model.names[joint])
        bodies[model.parents[joint]] = moved, model.jointPlacements[joint].inverse()
        into[moved - 1, model.joints[joint].idx_q - SLIDES] = -1.0
    for joint in range(BASE_JOINT + 1, model.njoints):
        if joint not in bodies:
            parent, place = bodies[model.parents[joint]]
            moved = tree.addJoint(parent, model.joints[joint], place * model.jointPlacements[joint], model.names[joint])
            bodies[joint] = moved, pinocchio.SE3.Identity()
            into[moved - 1, model.joints[joint].idx_q - SLIDES] = 1.0
    for joint, (moved, place) in bodies.items():
        tree.appendBodyToJoint(moved, model.inertias[joint], place)
    return tree, into
