"""From commanded torque to joint torque: dead time, saturation, rate limit, power loss, lag; what acts beside it.

    u_sat(t) = clip(u(t - delay), -limit, limit)     |du_rate/dt| <= rate towards u_sat; the same without a rate
    T dtau/dt = gain (1 - loss) u_rate - tau

Solved exactly over each substep h, in which u is constant: tau(t + h) = tau + (1 - exp(-h/T)) (u - tau). A plant holds
one torque over a substep; it gets the mean over the substep, which has the same impulse.

Joint damping acts beside the motors: -d M_jj(q) dq_j on actuated joint j, so that d alone would give the acceleration
-d dq_j to a joint free to move, whatever its inertia.
"""

from collections.abc import Sequence
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
    """The four motors of a robot, or of N. `torque` (4,), (N, 4): what they give at this instant, N m."""

    def __init__(self, *parameters: SimulationParameters) -> None:
        self._limit = np.array([[p.torque_limit] for p in parameters])
        gains = np.array([[getattr(p, f"{joint}_gain") for joint in ACTUATED] for p in parameters])
        self._efficiency = (gains * np.array([[1.0 - p.motor_loss] for p in parameters]))[:, None]
        self._most_change = np.array([[p.torque_rate * SUBSTEP_SECONDS] for p in parameters])
        delays = np.array([round(p.torque_delay / SUBSTEP_SECONDS) for p in parameters])
        self._delay = int(delays.max())
        self._comes_later = np.arange(self._delay + SUBSTEPS)[:, None] >= delays[:, None, None]  # than this tick begins
        responses = [_lag_response(p.motor_lag) for p in parameters]
        self._from_torque, self._from_drive, self._mean = (np.array(part) for part in zip(*responses, strict=True))
        self.reset()

    @property
    def torque(self) -> Array:
        return self._torque[0] if len(self._torque) == 1 else self._torque

    def reset(self) -> None:
        """Motors at rest, no command on its way."""
        robots = len(self._limit)
        self._torque = np.zeros((robots, 4))
        self._drives = np.zeros((robots, self._delay + SUBSTEPS, 4))  # of this tick's substeps, and those on their way
        self._reached = np.zeros((robots, 4))  # with a rate limit, of the saturated torque

    def going_on(self, robots: Array, parameters: Sequence[SimulationParameters]) -> "Actuation":
        """The motors of some robots, by number, with these parameters, as they are now."""
        other = Actuation(*parameters)
        known = min(self._delay, other._delay)
        other._torque, other._reached = self._torque[robots], self._reached[robots]
        other._drives[:, :known] = self._drives[robots, :known]
        return other

    def rest(self, robot: int) -> None:
        """Those of one robot come to rest, no command on its way."""
        self._torque[robot] = self._reached[robot] = self._drives[robot] = 0.0

    def advance(self, command: Array) -> Array:
        """Torques held over the substeps of one tick, N m: (SUBSTEPS, 4) for a command (4,), (N, SUBSTEPS, 4) for N."""
        limited = command.reshape(-1, 4).clip(-self._limit, self._limit)
        np.copyto(self._drives, limited[:, None], where=self._comes_later)
        drive = self._drives[:, :SUBSTEPS].copy()
        if self._delay:
            self._drives[:, : self._delay] = self._drives[:, SUBSTEPS:]
        drive = self._efficiency * (self._slewed(drive) if self._most_change.any() else drive)
        if not self._mean.any():
            self._torque = drive[:, -1]
            return drive.reshape(*command.shape[:-1], SUBSTEPS, 4)
        ends = self._from_torque[:, :, None] * self._torque[:, None] + self._from_drive @ drive
        starts = np.concatenate([self._torque[:, None], ends[:, :-1]], axis=1)
        self._torque = ends[:, -1]
        held: Array = drive + self._mean[:, None, None] * (starts - drive)
        return held.reshape(*command.shape[:-1], SUBSTEPS, 4)

    def _slewed(self, wanted: Array) -> Array:
        """Torques (N, SUBSTEPS, 4) that follow the wanted ones as fast as the rate allows; all, where there is none."""
        most, is_free = self._most_change, self._most_change == 0
        for substep in range(SUBSTEPS):
            row = wanted[:, substep]
            change = (row - self._reached).clip(-most, most)
            wanted[:, substep] = self._reached = np.where(is_free, row, self._reached + change)
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
