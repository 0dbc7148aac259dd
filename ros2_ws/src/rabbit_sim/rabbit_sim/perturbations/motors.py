"""From commanded torque to joint torque, in this order:

saturation, steps, dead time, dead zone, rate limit, power loss, lag of second and of first order.

    u_sat(t) = clip(u(t - delay), -limit, limit)     |du_rate/dt| <= rate towards u_sat; the same without a rate
    T dtau/dt = gain (1 - loss) u_rate - tau

A plant holds one torque over a substep; it gets the mean over the substep, which has the same impulse.
"""

from functools import cached_property, lru_cache
from math import pi
from typing import Annotated

import numpy as np
from pydantic import Field
from rabbit_description.state import ACTUATED, TORQUE_LIMIT, Array

from rabbit_sim.perturbation import Control, Number, Perturbation, WholeSubsteps, setting
from rabbit_sim.plant import SUBSTEP_SECONDS


class Saturation(Perturbation):
    """A motor gives no more."""

    order = 40
    acts_always = True

    torque_limit: Number = setting(TORQUE_LIMIT, 1e-6, 10000, "saturation of each motor, N m")

    def drive(self, torques: Array, state: Array) -> Array:
        return np.minimum(np.maximum(torques, -self.torque_limit), self.torque_limit)


class TorqueSteps(Perturbation):
    """A motor gives whole multiples of a step alone, as one behind switching valves does."""

    order = 45

    torque_step: Number = setting(0.0, 0, 200, "step of the torque that a motor can give, N m; 0: any torque")

    def drive(self, torques: Array, state: Array) -> Array:
        has_steps = np.asarray(self.torque_step) > 0
        step = np.where(has_steps, self.torque_step, 1.0)
        return np.where(has_steps, step * np.round(torques / step), torques)


class DeadTime(Perturbation):
    """The state is the torques on their way."""

    order = 50

    torque_delay: WholeSubsteps = setting(
        0.0, 0, 0.1, "dead time of the motors, whole ms, s", Control("delay", 0.001, "s", high=0.03, first=True)
    )

    @cached_property
    def delays(self) -> Array:
        """Substeps, (N, 1)."""
        return np.rint(np.asarray(self.torque_delay)[:, 0] / SUBSTEP_SECONDS).astype(int)

    def remembered(self) -> int:
        return int(self.delays.max())

    def drive(self, torques: Array, state: Array) -> Array:
        substeps = torques.shape[1]
        queue = np.concatenate([state, np.zeros_like(torques)], axis=1)
        queue[np.arange(len(state))[:, None], self.delays + np.arange(substeps)] = torques
        state[:] = queue[:, substeps:]
        return queue[:, :substeps]


class DeadZone(Perturbation):
    """Motors that do nothing until enough is asked: u - d sign(u) where |u| > d, else 0."""

    order = 55

    dead_zone: Number = setting(
        0.0,
        0,
        100,
        "torque below which a motor gives nothing, and which it always lacks, N m",
        Control("dead zone", 1, "N m"),
    )

    def drive(self, torques: Array, state: Array) -> Array:
        return torques - np.clip(torques, -self.dead_zone, self.dead_zone)


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
        for substep in range(torques.shape[1]):
            wanted = torques[:, substep]
            change = (wanted - reached).clip(-most, most)
            torques[:, substep] = reached = np.where(most == 0, wanted, reached + change)
        state[:, 0] = reached
        return torques


def gain(motor: str) -> float:
    """That of one motor."""
    return setting(1.0, 0.1, 2, "share of the torque that this motor gives", Control(f"{motor}'s motor", 0.05))


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
        return gains * (1.0 - self.motor_loss) * torques


class SecondOrderMotors(Perturbation):
    """Torque swings towards what is asked, as a current loop's does:  tau'' = w^2 (u - tau) - 2 z w tau'.

    Solved exactly over each substep, in which u is constant. The state is tau and tau'.
    """

    order = 75

    motor_frequency: Number = setting(
        0.0,
        0,
        500,
        "natural frequency of second-order motors, Hz; 0: none",
        Control("motors' frequency, 0: any", 1, "Hz"),
    )
    motor_damping: Number = setting(0.7, 0.05, 5, "damping ratio z of second-order motors")

    @cached_property
    def _steps(self) -> tuple[Array, Array]:
        """N robots' (tau, tau') at a substep's end, from those at its start (N, 2, 2) and from u (N, 2, 1)."""
        steps = map(of_motor, np.ravel(self.motor_frequency), np.ravel(self.motor_damping))
        from_state, from_drive = map(np.array, zip(*steps, strict=True))
        return from_state, from_drive

    def remembered(self) -> int:
        return 2

    def drive(self, torques: Array, state: Array) -> Array:
        from_state, from_drive = self._steps
        acts = np.asarray(self.motor_frequency)[:, 0] > 0
        for substep in range(torques.shape[1]):
            wanted, start = torques[:, substep].copy(), state[:, 0].copy()
            state[:] = from_state @ state + from_drive * wanted[:, None]
            torques[:, substep] = np.where(acts, (start + state[:, 0]) / 2, wanted)
        return torques


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

    def remembered(self) -> int:
        return 1

    def drive(self, torques: Array, state: Array) -> Array:
        responses = (response(float(lag), torques.shape[1]) for lag in np.ravel(self.motor_lag))
        from_torque, from_drive, mean = map(np.array, zip(*responses, strict=True))
        ends = from_torque[:, :, None] * state + from_drive @ torques
        starts = np.concatenate([state, ends[:, :-1]], axis=1)
        state[:] = ends[:, -1:]
        return torques + mean[:, None, None] * (starts - torques)


@lru_cache(maxsize=4096)
def response(lag: float, substeps: int) -> tuple[Array, Array, float]:
    """Torque at each substep's end from the first torque and from the drives; mean share of a substep's first error."""
    decay = float(np.exp(-SUBSTEP_SECONDS / lag)) if lag > 0 else 0.0
    age = np.subtract.outer(np.arange(substeps), np.arange(substeps))
    from_drive = np.where(age >= 0, (1 - decay) * decay ** np.maximum(age, 0), 0.0)
    return decay ** np.arange(1, substeps + 1), from_drive, (1 - decay) * lag / SUBSTEP_SECONDS


@lru_cache(maxsize=4096)  # a batch asks for all its robots again when one begins an episode
def of_motor(frequency: float, damping: float) -> tuple[Array, Array]:
    """One motor's step: what of its state (2, 2) and of the torque that is asked (2, 1) is there at the end."""
    from scipy.linalg import expm  # slow to import

    w = 2 * pi * frequency
    matrix = np.array([[0.0, 1.0, 0.0], [-(w**2), -2 * damping * w, w**2], [0.0, 0.0, 0.0]])
    step = expm(matrix * SUBSTEP_SECONDS)
    return step[:2, :2], step[:2, 2:]
