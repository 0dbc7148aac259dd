"""What is measured of the truth: the whole state with some noise, or only what a robot's own sensors say of it.

The sensors of a lab: an encoder at each joint, sampled at every substep; its drive fits a line through the last three
samples and gives the slope as the rate, so a rate is that of a millisecond ago. An IMU in the torso at the hip: gyro,
the attitude from the vertical that it integrates, and the mean of the accelerometer over the tick, impacts included.
All of it may arrive late: a tick's readings are then those of `sensor_delay` earlier.
"""

from copy import deepcopy
from itertools import pairwise
from math import cos, isnan, pi, radians, sin
from typing import Literal, Self

import numpy as np
from pydantic import model_validator
from rabbit_description.planar_urdf import BASE, SLIDES
from rabbit_description.state import DOF, JOINTS, Array, BodySensors, RobotState, orientation_of

from rabbit_sim.perturbation import Control, Memory, Number, Perturbation, WholeSubsteps, setting
from rabbit_sim.plant import SUBSTEP_SECONDS, PlantReading, gravity

ENCODER_STEP = 2 * pi / 2**14  # rad, of a lab's encoders unless another is given
RATE_SAMPLES = 3  # through which a drive fits its line
KEPT = 12  # states before a tick, a substep apart: as many as the longest delay has, and those samples


class Noise(Perturbation):
    """Noise of the encoders on pitch and the four joints, and of the foot force sensors.

    The base's position and velocity stay exact. Of a lab's sensors, those of the feet alone have it.
    """

    order = 130  # a lab's sensors draw theirs first

    encoder_resolution: Number = setting(0.0, 0, 0.1, "step of the measured angles, rad")
    velocity_noise: Number = setting(
        0.0, 0, 10, "std of exact sensors' angle rates, rad/s", Control("noise", 0.05, "rad/s", high=2, first=True)
    )
    force_noise: Number = setting(0.0, 0, 1000, "std of the measured foot forces, N")

    def measure(self, memory: Memory, state: RobotState, reading: PlantReading) -> None:
        rng = memory.rng
        if state.sensors is None:
            if self.encoder_resolution > 0:
                state.q[SLIDES:] = rounded(state.q[SLIDES:], self.encoder_resolution)
            if self.velocity_noise > 0:
                state.dq[SLIDES:] += self.velocity_noise * rng.standard_normal(DOF - SLIDES)
        if self.force_noise > 0:
            state.foot_force += self.force_noise * rng.standard_normal((2, 2))


class Laboratory(Perturbation):
    """A lab's sensors, each with constant errors that an episode draws; no base, no true rate."""

    order = 120
    switches = ("sensors",)
    needs_path = True

    sensors: Literal["exact", "lab"] = setting(
        "exact",
        None,
        None,
        "what is measured: the whole state, or encoders and IMU alone, which a filter makes a state of",
        Control("sensors", at_reset=True),
    )
    encoder_offset: Number = setting(0.001, 0, 0.1, "std of a joint's constant error, rad (lab)")
    gyro_noise: Number = setting(0.005, 0, 1, "std of the gyro, rad/s (lab)")
    gyro_bias: Number = setting(0.005, 0, 1, "std of the gyro's constant error, rad/s (lab)")
    accelerometer_noise: Number = setting(0.1, 0, 10, "std of the accelerometer, m/s^2 (lab)")
    accelerometer_bias: Number = setting(0.05, 0, 10, "std of the accelerometer's constant error, m/s^2 (lab)")
    attitude_error: Number = setting(0.003, 0, 0.1, "std of the IMU's first attitude, rad (lab)")
    sensor_delay: WholeSubsteps = setting(0.0, 0, 0.01, "age of the sensors' readings, whole ms, s (lab)")

    def begin(self, memory: Memory) -> None:
        rng = memory.rng
        memory.offset = self.encoder_offset * rng.standard_normal(JOINTS)
        memory.gyro_bias = self.gyro_bias * rng.standard_normal()
        memory.accelerometer_bias = self.accelerometer_bias * rng.standard_normal(2)
        memory.attitude_error = self.attitude_error * rng.standard_normal()
        memory.trace = None  # states of the last ticks, a substep apart

    def measure(self, memory: Memory, state: RobotState, reading: PlantReading) -> None:
        p, rng, last, path = memory.parameters, memory.rng, memory.trace, reading.path
        if path is None:  # a reset
            path = until(np.concatenate([reading.q, reading.dq]))
        memory.trace = np.vstack([until(path[0])[:-1] if last is None else last[-KEPT:], path])
        end = len(memory.trace) - round(self.sensor_delay / SUBSTEP_SECONDS)
        path, sampled = memory.trace[end - p.substeps - 1 : end], memory.trace[end - RATE_SAMPLES : end]
        specific_force = np.full(2, np.nan)
        if last is not None:
            memory.attitude_error += p.tick_seconds * (memory.gyro_bias + self.gyro_noise * rng.standard_normal())
            specific_force = mean_specific_force(path, gravity(p.slope))
            specific_force += memory.accelerometer_bias + self.accelerometer_noise * rng.standard_normal(2)
        angles = rounded(sampled[:, BASE:DOF] + memory.offset, p.encoder_resolution or ENCODER_STEP)
        state.q, state.dq = np.full((2, DOF), np.nan)
        state.sensors = BodySensors(
            joint_angles=angles[-1],
            joint_rates=(angles[-1] - angles[0]) / ((RATE_SAMPLES - 1) * SUBSTEP_SECONDS),
            orientation=orientation_of(path[-1, 2] - radians(p.slope) + memory.attitude_error),  # from the vertical
            pitch_rate=float(path[-1, DOF + SLIDES] + memory.gyro_bias + self.gyro_noise * rng.standard_normal()),
            specific_force=specific_force,
        )


class SensorJitter(Perturbation):
    """Each measurement's age is drawn from 0 to the oldest in whole ms. A lab's sensors have `sensor_delay` instead."""

    order = 125  # what is old has noise too
    needs_path = True

    sensor_jitter: WholeSubsteps = setting(
        0.0,
        0,
        0.02,
        "age of the oldest measurements, whole ms; each tick's is drawn, s",
        Control("age of measurements up to", 0.001, "s", at_reset=True),  # as `sensors`: with a lab's it is refused
    )

    @model_validator(mode="after")
    def _lab_has_a_delay(self) -> Self:
        if self.sensor_jitter and getattr(self, "sensors", "exact") == "lab":
            raise ValueError(f"sensor_jitter = {self.sensor_jitter:g} with sensors lab: expected 0, or sensor_delay")
        return self

    def begin(self, memory: Memory) -> None:
        memory.trace = np.zeros((0, 2 * DOF))  # states of the last ticks, a substep apart

    def measure(self, memory: Memory, state: RobotState, reading: PlantReading) -> None:
        oldest = round(self.sensor_jitter / SUBSTEP_SECONDS)
        path = reading.path if reading.path is not None else np.concatenate([state.q, state.dq])[None]
        memory.trace = np.vstack([memory.trace, path])[-oldest - memory.parameters.substeps :]
        age = min(int(memory.rng.integers(oldest + 1)), len(memory.trace) - 1)
        state.q, state.dq = memory.trace[-1 - age].reshape(2, DOF).copy()


class SensorDropout(Perturbation):
    """A tick's measurement is lost or not, whatever became of the last; the last one that came is repeated.

    An episode's first measurement always comes, and of a lab's sensors the first two: the first has no specific force.
    """

    order = 150

    sensor_dropout: Number = setting(
        0.0, 0, 0.9, "probability that a tick's measurement is lost", Control("lost measurements", 0.01)
    )

    def begin(self, memory: Memory) -> None:
        memory.last = None

    def measure(self, memory: Memory, state: RobotState, reading: PlantReading) -> None:
        is_lost = memory.last is not None and memory.rng.random() < self.sensor_dropout
        body = memory.last[-1] if is_lost else None
        if not is_lost or (body and isnan(body.specific_force[0])):
            memory.last = deepcopy((state.q, state.dq, state.foot_force, state.sensors))
        state.q, state.dq, state.foot_force, state.sensors = deepcopy(memory.last)


def until(state: Array) -> Array:
    """Path to `state` (14,), in which all moved as it does in the end, (KEPT + 1, 14)."""
    back = np.arange(-KEPT, 1)[:, None] * SUBSTEP_SECONDS
    return np.hstack([state[:DOF] + back * state[DOF:], np.tile(state[DOF:], (len(back), 1))])


def mean_specific_force(path: Array, fall: tuple[float, float]) -> Array:
    """What an accelerometer at the hip means over `path` (n, 14), states `SUBSTEP_SECONDS` apart, under gravity `fall`.

    Shape (2,), torso frame (forward, up), m/s^2.
    """
    if not np.isfinite(path).all():
        return np.full(2, np.nan)
    forward = up = 0.0
    for before, after in pairwise(path.tolist()):  # added up in this order, and with libm's sine, as in C
        x, z = ((after[DOF + i] - before[DOF + i]) / SUBSTEP_SECONDS - fall[i] for i in range(SLIDES))
        pitch = (after[2] + before[2]) / 2
        c, s = cos(pitch), sin(pitch)
        forward, up = forward + (c * x - s * z), up + (s * x + c * z)
    return np.array([forward, up]) / (len(path) - 1)


def rounded(angles: Array, step: float) -> Array:
    """The angles rounded to multiples of `step`."""
    return step * np.round(angles / step)
