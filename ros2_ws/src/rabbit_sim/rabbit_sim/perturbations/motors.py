"""From commanded torque to joint torque: saturation, dead time, rate limit, power loss, lag, in this order.

    u_sat(t) = clip(u(t - delay), -limit, limit)     |du_rate/dt| <= rate towards u_sat; the same without a rate
    T dtau/dt = gain (1 - loss) u_rate - tau

A plant holds one torque over a substep; it gets the mean over the substep, which has the same impulse.
"""

from functools import cached_property
from typing import Annotated

import numpy as np
from pydantic import Field
from rabbit_description.state import ACTUATED, TORQUE_LIMIT, Array

from rabbit_sim.perturbation import Control, Number, Perturbation, WholeSubsteps, setting
from rabbit_sim.plant import SUBSTEP_SECONDS, SUBSTEPS


class Saturation(Perturbation):
    """A motor gives no more."""

    order = 40
    acts_always = True

    torque_limit: Number = setting(TORQUE_LIMIT, 1e-6, 10000, "saturation of each motor, N m")

    def drive(self, torques: Array, state: Array) -> Array:
        return np.minimum(np.maximum(torques, -self.torque_limit), self.torque_limit)


class DeadTime(Perturbation):
    """The state is the torques of a tick's substeps, and those on their way."""

    order = 50

    torque_delay: WholeSubsteps = setting(
        0.0, 0, 0.1, "dead time of the motors, whole ms, s", Control("delay", 0.001, "s", high=0.03, first=True)
    )

    @cached_property
    def delays(self) -> Array:
        """Substeps, (N, 1)."""
        return np.rint(np.asarray(self.torque_delay)[:, 0] / SUBSTEP_SECONDS).astype(int)

    def remembered(self) -> int:
        return int(self.delays.max()) + SUBSTEPS

    def drive(self, torques: Array, state: Array) -> Array:
        state[np.arange(len(state))[:, None], self.delays + np.arange(SUBSTEPS)] = torques
        now = state[:, :SUBSTEPS].copy()
        state[:, :-SUBSTEPS] = state[:, SUBSTEPS:]
        return now


class TorqueRate(Perturbation):
    """The state is the torque that has been reached."""

    order = 60

    torque_rate: Number = setting(
        0.0, 0, 1e6, "most that the torque changes, N m/s; 0: no limit", Control("torque rate, 0: any", 1000, "N m/s")
    )

    def remembered(self) -> int:
        return 1

    def drive(self, torques: Array, state: Array) -> Array:
        most, reached = np.asarray(self.torque_rate)[:, 0] * SUBSTEP_SECONDS, state[:, 0]
        for substep in range(SUBSTEPS):
            wanted = torques[:, substep]
            change = (wanted - reached).clip(-most, most)
            torques[:, substep] = reached = np.where(most == 0, wanted, reached + change)
        state[:, 0] = reached
        return torques


def gain(motor: str) -> float:
    """That of one motor."""
    field: float = setting(1.0, 0.1, 2, "share of the torque that this motor gives", Control(f"{motor}'s motor", 0.05))
    return field


class MotorGains(Perturbation):
    """All motors may give less than is asked, or one."""

    order = 70

    motor_loss: Annotated[Number, Field(lt=1)] = setting(0.0, 0, None, "fraction of the torque that is lost")
    left_hip_gain: Number = gain("left hip")
    left_knee_gain: Number = gain("left knee")
    right_hip_gain: Number = gain("right hip")
    right_knee_gain: Number = gain("right knee")

    def drive(self, torques: Array, state: Array) -> Array:
        gains = np.concatenate([getattr(self, f"{joint}_gain") for joint in ACTUATED], axis=2)
        given: Array = gains * (1.0 - self.motor_loss) * torques
        return given


class MotorLag(Perturbation):
    """Solved exactly over each substep h, in which u is constant: tau(t + h) = tau + (1 - exp(-h/T)) (u - tau).

    The state is tau.
    """

    order = 80

    motor_lag: Number = setting(
        0.0,
        0,
        0.1,
        "first-order time constant of the motors, s",
        Control("motor lag", 0.001, "s", high=0.05, first=True),
    )

    @cached_property
    def responses(self) -> tuple[Array, Array, Array]:
        """Those of `response` for N robots."""
        parts = zip(*(response(float(lag)) for lag in np.ravel(self.motor_lag)), strict=True)
        from_torque, from_drive, mean = map(np.array, parts)
        return from_torque[:, :, None], from_drive, mean[:, None, None]

    def remembered(self) -> int:
        return 1

    def drive(self, torques: Array, state: Array) -> Array:
        from_torque, from_drive, mean = self.responses
        ends = from_torque * state + from_drive @ torques
        starts = np.concatenate([state, ends[:, :-1]], axis=1)
        state[:] = ends[:, -1:]
        held: Array = torques + mean * (starts - torques)
        return held


def response(lag: float) -> tuple[Array, Array, float]:
    """Torque at each substep's end from the first torque and from the drives; mean share of a substep's first error."""
    decay = float(np.exp(-SUBSTEP_SECONDS / lag)) if lag > 0 else 0.0
    age = np.subtract.outer(np.arange(SUBSTEPS), np.arange(SUBSTEPS))
    from_drive = np.where(age >= 0, (1 - decay) * decay ** np.maximum(age, 0), 0.0)
    return decay ** np.arange(1, SUBSTEPS + 1), from_drive, (1 - decay) * lag / SUBSTEP_SECONDS
