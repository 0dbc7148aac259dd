"""The true robot by pinocchio, for comparison, and states of it."""

import numpy as np
import pinocchio
from rabbit_description.gait import load_gait
from rabbit_description.state import Array
from rabbit_sim.initial_state import initial_state
from rabbit_sim.kinematics import RabbitFeet
from rabbit_sim.parameters import SimulationParameters
from rabbit_sim.perturbations.joints import JointDamping
from rabbit_sim.pinned_dynamics import PinnedDynamics
from rabbit_sim.plant import gravity
from rabbit_sim.robot_urdf import leg_shape, perturbed_urdf, with_attached


class Truth:
    """What must be true of the robot with these parameters."""

    def __init__(self, **changes) -> None:
        self.parameters = SimulationParameters(**changes)
        self.urdf = perturbed_urdf(self.parameters)
        self.mass = 32.0 * self.parameters.mass_scale + self.parameters.payload
        self._model = pinocchio.buildModelFromXML(self.urdf)
        self._loaded = pinocchio.buildModelFromXML(with_attached(self.urdf, self.parameters))
        self._loaded.gravity.linear[[0, 2]] = gravity(self.parameters.slope)
        self._data = self._model.createData()

    def start(self, seed: int = 1) -> tuple[Array, Array]:
        """A first state `(q, dq)`, left stance."""
        return initial_state(self.parameters, load_gait("authors_035"), np.random.default_rng(seed))

    def pinned(self) -> PinnedDynamics:
        """Our model of it in stance."""
        damping = JointDamping(joint_damping=self.parameters.joint_damping).joint_torque(self.urdf)
        return PinnedDynamics(self.urdf, RabbitFeet(leg_shape(self.parameters)), [damping])

    def jacobian(self, q, leg):
        """Of a foot, (2, 7)."""
        return RabbitFeet(leg_shape(self.parameters)).jacobian(q, leg)

    def mass_matrix(self, q):
        return pinocchio.crba(self._model, self._data, q)

    def free_acceleration(self, q, dq, torque):
        """From the equation of motion without contact, the damping as the documents give it, what is loose at rest."""
        damping = self.parameters.joint_damping * self.mass_matrix(q).diagonal()[3:] * dq[3:]
        forces = np.r_[np.zeros(3), torque - damping]
        hangs = np.deg2rad(self.parameters.slope) - q[2], -dq[2]  # along gravity, and does not turn
        loose = [hangs if name == "swing_payload" else (0.0, 0.0) for name in list(self._loaded.names)[8:]]
        more, rates = np.array(loose).reshape(-1, 2).T
        forces = np.r_[forces, 0.0 * more]
        return pinocchio.aba(self._loaded, self._loaded.createData(), np.r_[q, more], np.r_[dq, rates], forces)[:7]

    def kinetic_energy(self, q, dq):
        return pinocchio.computeKineticEnergy(self._model, self._data, q, dq)

    def energy(self, q, dq):
        return self.kinetic_energy(q, dq) + pinocchio.computePotentialEnergy(self._model, self._data, q)

    def momentum(self, q, dq):
        """Linear, x and z."""
        return np.asarray(pinocchio.computeCentroidalMomentum(self._model, self._data, q, dq).linear)[[0, 2]]

    def angular_momentum(self, q, dq, point):
        """About +y and a point (x, z)."""
        about_com = pinocchio.computeCentroidalMomentum(self._model, self._data, q, dq).angular[1]
        arm = np.asarray(self._data.com[0])[[0, 2]] - point
        linear = self.momentum(q, dq)
        return about_com + arm[1] * linear[0] - arm[0] * linear[1]


def random_state(seed: int) -> tuple[Array, Array]:
    """`(q, dq)` in the air."""
    rng = np.random.default_rng(seed)
    q = np.array([0.3, 3.0, 0.1, -0.3, 0.5, -0.3, 0.6]) + rng.uniform(-0.4, 0.4, 7)
    return q, rng.uniform(-4, 4, 7)
