"""From commanded torque to joint torque: dead time, saturation, rate limit, power loss, lag; what acts beside it.

    u_sat(t) = clip(u(t - delay), -limit, limit)     |du_rate/dt| <= rate towards u_sat; the same without a rate
    T dtau/dt = gain (1 - loss) u_rate - tau

Solved exactly over each substep h, in which u is constant: tau(t + h) = tau + (1 - exp(-h/T)) (u - tau). A plant holds
one torque over a substep; it gets the mean over the substep, which has the same impulse.

Joint damping acts beside the motors: -d M_jj(q) dq_j on actuated joint j, so that d alone would give the acceleration
-d dq_j to a joint free to move, whatever its inertia.
"""

from math import radians, sqrt

import numpy as np
import pinocchio
from rabbit_description.state import ACTUATED, Array

from rabbit_sim.parameters import SUBSTEP_SECONDS, SimulationParameters
from rabbit_sim.plant import SUBSTEPS

ROTOR_INERTIA = 0.05  # kg m^2, reflected
GEAR_STIFFNESS = 5000.0  # N m/rad
GEAR_DAMPING_RATIO = 0.2  # of a rotor against a joint that stands still


class Actuation:
    """The four motors. `torque` (4,): what they give at this instant, N m."""

    def __init__(self, parameters: SimulationParameters) -> None:
        self._limit = parameters.torque_limit
        gains = np.array([getattr(parameters, f"{joint}_gain") for joint in ACTUATED])
        self._efficiency = gains * (1.0 - parameters.motor_loss)
        self._most_change = parameters.torque_rate * SUBSTEP_SECONDS
        self._delay = round(parameters.torque_delay / SUBSTEP_SECONDS)
        self._from_torque, self._from_drive, self._mean = _lag_response(parameters.motor_lag)
        self.reset()

    def reset(self) -> None:
        """Motors at rest, no command on its way."""
        self.torque = np.zeros(4)
        self._drives = np.zeros((self._delay + SUBSTEPS, 4))  # of this tick's substeps, and those on their way
        self._reached = np.zeros(4)  # with a rate limit, of the saturated torque

    def advance(self, command: Array) -> Array:
        """Torques held over the substeps of one tick, shape (SUBSTEPS, 4), N m, for a command of shape (4,)."""
        self._drives[self._delay :] = command.clip(-self._limit, self._limit)
        drive = self._drives[:SUBSTEPS].copy()
        self._drives[: self._delay] = self._drives[SUBSTEPS:]
        drive = self._efficiency * (self._slewed(drive) if self._most_change else drive)
        if not self._mean:
            self.torque = drive[-1]
            return drive
        ends = self._from_torque[:, None] * self.torque + self._from_drive @ drive
        starts = np.empty_like(ends)
        starts[0], starts[1:] = self.torque, ends[:-1]
        self.torque = ends[-1]
        return drive + self._mean * (starts - drive)

    def _slewed(self, wanted: Array) -> Array:
        """Torques (SUBSTEPS, 4) that follow the wanted ones as fast as the rate allows."""
        for row in wanted:
            self._reached = self._reached + (row - self._reached).clip(-self._most_change, self._most_change)
            row[:] = self._reached
        return wanted


class Gears:
    """Elastic gears with play: a rotor of inertia J at each joint drives it through a spring k and a damper c.

    With s = rotor - joint the joint gets k (s -+ b / 2) + c s' outside of the play b, and nothing within it. A tooth
    does not pull; without play the spring does.
    """

    def __init__(self, backlash: float, stiffness: float) -> None:
        """`backlash` in degrees; `stiffness` in N m/rad, 0 for `GEAR_STIFFNESS`."""
        self._half = radians(backlash) / 2
        self._stiffness = stiffness or GEAR_STIFFNESS
        self._damper = 2 * GEAR_DAMPING_RATIO * sqrt(self._stiffness * ROTOR_INERTIA)

    def reset(self, joints: Array, rates: Array) -> None:
        """Rotors in the middle of the play, where the joints (4,) are, rad, and as fast, rad/s."""
        self._rotor, self._rate = joints.copy(), rates.copy()

    def transmitted(self, torque: Array, joints: Array, rates: Array) -> Array:
        """To the joints (4,), N m, over the next substep, in which the motors give `torque` (4,)."""
        slip, slip_rate = self._rotor - joints, self._rate - rates
        beyond = slip - slip.clip(-self._half, self._half)
        passed: Array = self._stiffness * beyond + self._damper * slip_rate
        if self._half:
            side = np.sign(beyond)
            passed = side * np.maximum(side * passed, 0.0)
        self._rate = self._rate + SUBSTEP_SECONDS * (torque - passed) / ROTOR_INERTIA
        self._rotor = self._rotor + SUBSTEP_SECONDS * self._rate
        return passed


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
