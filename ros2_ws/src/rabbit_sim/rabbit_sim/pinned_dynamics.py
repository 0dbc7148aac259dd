"""The paper's hybrid model of a planar robot with two point feet.

In stance, the foot pinned:   M ddq + h = B tau + J' F,   J ddq + dJ/dt dq = 0
At impact of the other foot:  M (dq+ - dq-) = J' L,       J dq+ = 0

M mass matrix, h bias forces, B tau joint torques on the coordinates after the base's three, J Jacobian (2, n) of the
pinned foot, F its ground force, L its impulse (both x, z). Inelastic impact, no slip, the old stance foot free at once
(Grizzle, Abba, Plestan 2001). In stance the robot is a tree that grows from its foot (`PinnedChain`), which knows no F;
the first two rows of M ddq + h, those of the base's slides, are F.
"""

from collections.abc import Callable, Sequence

import numpy as np
import pinocchio
from rabbit_description.planar_urdf import BASE, SLIDES
from rabbit_description.state import Array, Leg

from rabbit_sim.kinematics import RabbitFeet
from rabbit_sim.perturbation import JointTorque
from rabbit_sim.plant import gravity

PLANE = [0, 2]  # x and z of a spatial vector
BASE_JOINT = BASE  # pinocchio's number of the base's pitch


class PinnedDynamics:
    """The dynamics of the robot that `urdf` describes, its feet where `feet` says.

    `beside`: torques (n - 3,), N m, of q and dq (n,), that act beside the motors' in each joint, such as damping.
    `slope`: rise of the ground, in whose frame all is, degrees. `weight` (2,): what the ground carries at rest, N.
    `chains`: the robot grown from its left and from its right foot; `model`, `data`: pinocchio's of the whole robot.
    """

    def __init__(self, urdf: str, feet: RabbitFeet, beside: Sequence[JointTorque] = (), slope: float = 0.0) -> None:
        self.feet = feet
        self.model = pinocchio.buildModelFromXML(urdf)
        self.model.gravity.linear[PLANE] = gravity(slope)
        self.data = self.model.createData()
        self._beside = beside
        self.coordinates: int = self.model.nv
        self.chains = [PinnedChain(self.model, self.model.getFrameId(link)) for link in feet.links]
        self.weight = pinocchio.computeTotalMass(self.model) * -np.array(gravity(slope))

    def in_chain(self, stance: Leg, torque: Array) -> Callable[[Array, Array], Array]:
        """z-ddot of the stance foot's chain as a function of z and z-dot, under joint torques (n - 3,), N m."""
        chain = self.chains[stance]
        if not self._beside:
            forces = torque.dot(chain.drives)
            return lambda z, dz: pinocchio.aba(chain.model, chain.data, z, dz, forces)
        q, dq = np.zeros((2, self.coordinates))

        def acceleration(z: Array, dz: Array) -> Array:
            q[SLIDES:], dq[SLIDES:] = chain.out @ z, chain.out @ dz
            at_joints: Array = sum((beside(q, dq) for beside in self._beside), torque)
            return pinocchio.aba(chain.model, chain.data, z, dz, at_joints.dot(chain.drives))

        return acceleration

    def momentum(self, q: Array, dq: Array) -> Array:
        """Linear, x and z, N s."""
        return pinocchio.computeCentroidalMomentum(self.model, self.data, q, dq).linear[PLANE]

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
    base's two slides, which carry no mass. `into` (k, k) is C, `out` its inverse; joint torques (k - 1,), N m, times
    `drives` (k - 1, k) are the forces on z, for the power is the same.
    """

    def __init__(self, model: pinocchio.Model, foot: int) -> None:
        self.model, self.into = _grown_from(model, foot)
        self.data = self.model.createData()
        self.out: Array = np.linalg.inv(self.into)
        self.drives: Array = self.out[1:].copy()


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
    into[0, [model.joints[joint].idx_q - SLIDES for joint in [BASE_JOINT, *way]]] = 1.0
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
