"""The paper's hybrid model of the robot, with any perturbed parameters.

In stance, the foot pinned:   M ddq + h = B tau + J' F,   J ddq + dJ/dt dq = 0
At impact of the other foot:  M (dq+ - dq-) = J' L,       J dq+ = 0

M mass matrix, h bias forces, B tau joint torques on the last four coordinates, J Jacobian (2, 7) of the pinned foot,
F its ground force, L its impulse (both x, z). Inelastic impact, no slip, the old stance foot free at once (Grizzle,
Abba, Plestan 2001). Both are one linear system in the acceleration or velocity and the force.
"""

import numpy as np
import pinocchio
from rabbit_description.state import Array, Leg

from rabbit_sim.kinematics import centripetal_acceleration, foot_jacobian


class PinnedDynamics:
    """Of the robot that `urdf` describes, its links bent by `bend`, its joints damped by `damping` (1/s)."""

    def __init__(self, urdf: str, bend: float = 0.0, damping: float = 0.0) -> None:
        self._model = pinocchio.buildModelFromXML(urdf)
        self._data = self._model.createData()
        self._bend = bend
        self._damping = damping
        self._system = np.zeros((9, 9))
        self._right_side = np.zeros(9)

    def accelerations(self, q: Array, dq: Array, torque: Array, stance: Leg) -> tuple[Array, Array]:
        """`ddq` (7,) and the ground force (2,) on the stance foot, x and z, N, under joint torques (4,), N m."""
        inertia = self._fill_system(q, stance)
        right = self._right_side
        right[:7] = -pinocchio.nle(self._model, self._data, q, dq)
        right[3:7] += torque - self._damping * inertia[3:] * dq[3:]
        right[7:] = -centripetal_acceleration(q, dq, stance, self._bend)
        solution = np.linalg.solve(self._system, right)
        return solution[:7], -solution[7:]

    def impact(self, q: Array, dq: Array, landing: Leg) -> tuple[Array, Array]:
        """`dq` (7,) after the foot `landing` has come to rest, and the impulse (2,) on it, x and z, N s."""
        self._fill_system(q, landing)
        right = self._right_side
        right[:7] = self._system[:7, :7] @ dq
        right[7:] = 0.0
        solution = np.linalg.solve(self._system, right)
        return solution[:7], -solution[7:]

    def _fill_system(self, q: Array, leg: Leg) -> Array:
        """The matrix [[M, J'], [J, 0]], whose second unknown is minus the force; returns M's diagonal, shape (7,)."""
        mass: Array = pinocchio.crba(self._model, self._data, q)
        self._system[:7, :7] = mass
        jacobian = foot_jacobian(q, leg, self._bend)
        self._system[7:, :7] = jacobian
        self._system[:7, 7:] = jacobian.T
        return mass.diagonal()
