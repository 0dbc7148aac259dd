"""A planar robot as a tree that grows from its pinned foot: without base, slides and constraint.

Its coordinates z are the absolute angle of the pinned foot's link, then the joints from that foot to the base, passed
backwards and so with the other sign, then all other joints: z = C q_r, where q_r is q without the base's two slides.
"""

import numpy as np
import pinocchio
from rabbit_description.planar_urdf import BASE, UrdfError
from rabbit_description.state import Array

SLIDES = 2
BASE_JOINT = len(BASE)  # pinocchio's number of the base's pitch
PITCH = "JointModelRY"


class PinnedChain:
    """Of a planar `model` whose frame `foot` (its number) is pinned; k = n - 2 coordinates.

    `into` (k, k) is C, `out` its inverse: q_r = out z.

    Raises:
        UrdfError: the base's slides carry a mass.
    """

    def __init__(self, model: pinocchio.Model, foot: int) -> None:
        if any(model.inertias[joint].mass for joint in range(1, BASE_JOINT)):
            raise UrdfError(f"URDF {model.name}: expected massless slides {', '.join(BASE[:SLIDES])}")
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
