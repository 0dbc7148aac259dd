"""What is measured of the truth: the whole state with some noise, or only what a robot's own sensors say of it.

The sensors of a lab: an encoder at each joint, sampled at every substep; its drive fits a line through the last three
samples and gives the slope as the rate, so a rate is that of a millisecond ago. An IMU in the torso at the hip: gyro,
the attitude from the vertical that it integrates, and the mean of the accelerometer over the tick, impacts included.
All of it may arrive late: a tick's readings are then those of `sensor_delay` earlier.
"""

from dataclasses import dataclass
from math import pi, radians
from typing import Protocol

import numpy as np
from rabbit_description.state import TICK_SECONDS, Array, BodySensors, orientation_of

from rabbit_sim.parameters import SUBSTEP_SECONDS, SimulationParameters
from rabbit_sim.plant import SUBSTEPS, PlantReading, gravity

ENCODER_STEP = 2 * pi / 2**14  # rad, of a lab's encoders unless another is given
RATE_SAMPLES = 3  # through which a drive fits its line


@dataclass(frozen=True)
class Measured:
    """`q`, `dq` (7,) and `foot_force` (2, 2) as the controller gets them; `body`: where these are all there is."""

    q: Array
    dq: Array
    foot_force: Array
    body: BodySensors | None = None


class Sensors(Protocol):
    """What an episode's sensors do; `rng` draws their noise. `parameters` may change between two ticks."""

    parameters: SimulationParameters
    rng: np.random.Generator

    def measure(self, reading: PlantReading) -> Measured:
        """The measurement of a tick; called once for each, the first time right after a reset."""


def make_sensors(parameters: SimulationParameters, rng: np.random.Generator) -> Sensors:
    """Those that the parameters name."""
    return (LabSensors if parameters.sensors == "lab" else ExactSensors)(parameters, rng)


class ExactSensors:
    """Encoders on pitch and the four joints, foot force sensors. The base's position and velocity are exact."""

    def __init__(self, parameters: SimulationParameters, rng: np.random.Generator) -> None:
        self.parameters = parameters
        self.rng = rng

    def measure(self, reading: PlantReading) -> Measured:
        """See `Sensors`."""
        q, dq = reading.q.copy(), reading.dq.copy()
        step = self.parameters.encoder_resolution
        if step > 0:
            q[2:] = rounded(q[2:], step)
        if self.parameters.velocity_noise > 0:
            dq[2:] += self.parameters.velocity_noise * self.rng.standard_normal(5)
        return Measured(q, dq, noisy_force(reading, self.parameters.force_noise, self.rng))


class LabSensors:
    """Encoders and an IMU, each with constant errors that an episode draws; no base, no true rate."""

    def __init__(self, parameters: SimulationParameters, rng: np.random.Generator) -> None:
        p = self.parameters = parameters
        self.rng = rng
        self._offset = p.encoder_offset * rng.standard_normal(4)
        self._gyro_bias = p.gyro_bias * rng.standard_normal()
        self._accelerometer_bias = p.accelerometer_bias * rng.standard_normal(2)
        self._attitude_error = p.attitude_error * rng.standard_normal()
        self._trace: Array | None = None  # states of the last two ticks, a substep apart

    def measure(self, reading: PlantReading) -> Measured:
        """See `Sensors`."""
        p, rng, last, path = self.parameters, self.rng, self._trace, reading.path
        if path is None:  # a reset
            path = until(np.concatenate([reading.q, reading.dq]))
        self._trace = np.vstack([until(path[0])[:-1] if last is None else last[-SUBSTEPS - 1 :], path])
        end = len(self._trace) - round(p.sensor_delay / SUBSTEP_SECONDS)
        path = self._trace[end - SUBSTEPS - 1 : end]
        specific_force = np.full(2, np.nan)
        if last is not None:
            self._attitude_error += TICK_SECONDS * (self._gyro_bias + p.gyro_noise * rng.standard_normal())
            specific_force = mean_specific_force(path, gravity(p.slope))
            specific_force += self._accelerometer_bias + p.accelerometer_noise * rng.standard_normal(2)
        angles = rounded(path[-RATE_SAMPLES:, 3:7] + self._offset, p.encoder_resolution or ENCODER_STEP)
        body = BodySensors(
            joint_angles=angles[-1],
            joint_rates=(angles[-1] - angles[0]) / ((RATE_SAMPLES - 1) * SUBSTEP_SECONDS),
            orientation=orientation_of(path[-1, 2] - radians(p.slope) + self._attitude_error),  # from the vertical
            pitch_rate=float(path[-1, 9] + self._gyro_bias + p.gyro_noise * rng.standard_normal()),
            specific_force=specific_force,
        )
        unknown = np.full(7, np.nan)
        return Measured(unknown, unknown.copy(), noisy_force(reading, p.force_noise, rng), body)


def until(state: Array) -> Array:
    """Path to `state` (14,) of more than a tick, in which all moved as it does in the end, (12, 14)."""
    back = np.arange(-SUBSTEPS - 1, 1)[:, None] * SUBSTEP_SECONDS
    return np.hstack([state[:7] + back * state[7:], np.tile(state[7:], (len(back), 1))])


def mean_specific_force(path: Array, fall: tuple[float, float]) -> Array:
    """What an accelerometer at the hip means over `path` (n, 14), states `SUBSTEP_SECONDS` apart, under gravity `fall`.

    Shape (2,), torso frame (forward, up), m/s^2.
    """
    gained = np.diff(path[:, 7:9], axis=0) / SUBSTEP_SECONDS - fall
    pitch = (path[1:, 2] + path[:-1, 2]) / 2
    c, s = np.cos(pitch), np.sin(pitch)
    forward, up = c * gained[:, 0] - s * gained[:, 1], s * gained[:, 0] + c * gained[:, 1]
    return np.array([forward.mean(), up.mean()])


def rounded(angles: Array, step: float) -> Array:
    """To multiples of `step`."""
    return step * np.round(angles / step)


def noisy_force(reading: PlantReading, std: float, rng: np.random.Generator) -> Array:
    """The feet's forces (2, 2), N."""
    force = reading.foot_force.copy()
    if std > 0:
        force += std * rng.standard_normal((2, 2))
    return force
