"""From commanded torque to joint torque: dead time, saturation, power loss and lag.

    u_sat(t) = clip(u(t - delay), -limit, limit)
    T dtau/dt = (1 - loss) u_sat - tau

Solved exactly over each substep h, in which u is constant: tau(t + h) = tau + (1 - exp(-h/T)) (u - tau). A plant holds
one torque over a substep; it gets the mean over the substep, which has the same impulse.

Joint damping acts beside the motors: -d M_jj(q) dq_j on actuated joint j, so that d alone would give the acceleration
-d dq_j to a joint free to move, whatever its inertia.
"""

import numpy as np
import pinocchio
from rabbit_description.state import Array

from rabbit_sim.parameters import SUBSTEP_SECONDS, SimulationParameters
from rabbit_sim.plant import SUBSTEPS


class Actuation:
    """The four motors. `torque` (4,): what they give at this instant, N m."""

    def __init__(self, parameters: SimulationParameters) -> None:
        self._limit = parameters.torque_limit
        self._efficiency = 1.0 - parameters.motor_loss
        self._delay = round(parameters.torque_delay / SUBSTEP_SECONDS)
        self._from_torque, self._from_drive, self._mean = _lag_response(parameters.motor_lag)
        self.reset()

    def reset(self) -> None:
        """Motors at rest, no command on its way."""
        self.torque = np.zeros(4)
        self._drives = np.zeros((self._delay + SUBSTEPS, 4))  # of this tick's substeps, and those on their way

    def advance(self, command: Array) -> Array:
        """Torques held over the substeps of one tick, shape (SUBSTEPS, 4), N m, for a command of shape (4,)."""
        self._drives[self._delay :] = self._efficiency * command.clip(-self._limit, self._limit)
        drive = self._drives[:SUBSTEPS].copy()
        self._drives[: self._delay] = self._drives[SUBSTEPS:]
        if not self._mean:
            self.torque = drive[-1]
            return drive
        ends = self._from_torque[:, None] * self.torque + self._from_drive @ drive
        starts = np.empty_like(ends)
        starts[0], starts[1:] = self.torque, ends[:-1]
        self.torque = ends[-1]
        return drive + self._mean * (starts - drive)


class JointDamping:
    """Viscous torque of the robot that `urdf` describes, coefficient `d` in 1/s."""

    def __init__(self, urdf: str, d: float) -> None:
        self._model = pinocchio.buildModelFromXML(urdf)
        self._data = self._model.createData()
        self._d = d

    def torque(self, q: Array, dq: Array) -> Array:
        """-d M_jj(q) dq_j of the actuated joints, shape (4,), N m."""
        inertia: Array = pinocchio.crba(self._model, self._data, q).diagonal()[3:]
        return -self._d * inertia * dq[3:]


def _lag_response(lag: float) -> tuple[Array, Array, float]:
    """Torque at each substep's end from the first torque and from the drives; mean share of a substep's first error."""
    decay = float(np.exp(-SUBSTEP_SECONDS / lag)) if lag > 0 else 0.0
    age = np.subtract.outer(np.arange(SUBSTEPS), np.arange(SUBSTEPS))
    from_drive = np.where(age >= 0, (1 - decay) * decay ** np.maximum(age, 0), 0.0)
    return decay ** np.arange(1, SUBSTEPS + 1), from_drive, (1 - decay) * lag / SUBSTEP_SECONDS
