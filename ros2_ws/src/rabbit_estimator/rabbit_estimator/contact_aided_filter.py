"""The state of a planar biped from its own sensors: a contact-aided extended Kalman filter.

After Bloesch et al., "State estimation for legged robots: consistent fusion of leg kinematics and IMU" (RSS 2012), in
the plane, with the joints' rates and the encoders' zeros among what is estimated. It knows the lengths of the links and
no mass, so it does not care what the true masses are.

    x = (p, v, pitch, j, j', j'', c, b_g, b_a, o)

    p, v    hip, world: position, velocity          c      stance foot's centre, world
    j       the four joint angles                   b_g    constant error of the gyro
    j', j'' their rates and accelerations           b_a    of the accelerometer, torso frame
                                                    o      of the encoders

The IMU moves the hip from tick to tick: its attitude turns the torso, its specific force f changes the velocity,
v+ = v + (R(pitch) (f - b_a) - g) dt. The joints move on with their accelerations, which wander. Measured are the
encoders' angles j + o, their drives' rates j' - lag j'', and that the stance foot stands: p + leg(pitch, j) - c = 0,
v + d/dt leg(pitch, j) = 0. When the swing foot touches down, it becomes the stance foot: c is where the legs say that
it is, and the joints' rates may have jumped.
"""

from dataclasses import dataclass, replace

import numpy as np
from rabbit_description.state import TICK_SECONDS, Array, BodySensors, Leg, RobotState

from rabbit_estimator.leg_kinematics import foothold, foothold_jacobian, foothold_rate_by_angles
from rabbit_estimator.parameters import EstimatorParameters

DT = TICK_SECONDS
GRAVITY = np.array([0.0, -9.81])

P, V, PITCH, J, DJ, DDJ = slice(0, 2), slice(2, 4), 4, slice(5, 9), slice(9, 13), slice(13, 17)
C, GYRO, ACCELEROMETER, OFFSET = slice(17, 19), 19, slice(20, 22), slice(22, 26)
SIZE = 26
SURPRISE = 26.1  # of the encoders' normalised innovation squared: chi-square with 8 degrees exceeds it once in 1,000
ENCODERS = 8  # angles and rates: what is measured without the ground


class EstimatorError(ValueError):
    """What the filter was given cannot be used."""


@dataclass(frozen=True)
class Innovation:
    """What a tick measured less what the filter expected, (m,), and its covariance, (m, m)."""

    value: Array
    covariance: Array

    @property
    def nis(self) -> float:
        """Normalised innovation squared: chi-square with m degrees of freedom for a consistent filter."""
        return float(self.value @ np.linalg.solve(self.covariance, self.value))


class ContactAidedFilter:
    """One robot's state, tick by tick: `update` takes what its sensors say and fills in `q` and `dq`.

    `mean` (26,) and `covariance` (26, 26) of x; `innovation` of the last tick, None at tick 0.
    """

    mean: Array
    covariance: Array
    innovation: Innovation | None

    def __init__(self, parameters: EstimatorParameters) -> None:
        self.parameters = parameters
        self._f = np.eye(SIZE)
        self._f[P, V] = DT * np.eye(2)
        self._f[PITCH, GYRO] = -DT
        self._f[J, DJ] = self._f[DJ, DDJ] = DT * np.eye(4)
        self._f[J, DDJ] = DT**2 / 2 * np.eye(4)
        self._q = process_noise(parameters)
        self.innovation = None
        self._tick = -1

    def update(self, state: RobotState) -> RobotState:
        """The state with `q`, `dq` estimated; tick 0 begins a new episode, the left foot at rest at (0, 0).

        Raises:
            EstimatorError: no sensors in it, numbers that are not finite, or not the tick after the last one.
        """
        sensors = state.sensors
        if sensors is None:
            raise EstimatorError("state.sensors = None: expected encoders and IMU, as the simulator's sensors lab give")
        check(sensors, state.tick)
        if state.tick == 0:
            self._begin(sensors)
        elif state.tick != self._tick + 1:
            raise EstimatorError(f"state.tick = {state.tick}: expected {self._tick + 1}, or 0 for a new episode")
        else:
            self._predict(sensors)
            landed = self._watch_feet(state)
            self._correct(sensors, landed)
        self._tick, self._attitude, self._pitch_rate = state.tick, sensors.attitude, sensors.pitch_rate
        return replace(state, q=self.q, dq=self.dq)

    @property
    def q(self) -> Array:
        """Estimated coordinates (7,), m, rad."""
        x = self.mean
        return np.concatenate([x[P], x[PITCH : PITCH + 1], x[J]])

    @property
    def dq(self) -> Array:
        """Estimated rates (7,), m/s, rad/s."""
        x = self.mean
        return np.concatenate([x[V], [self._rate], x[DJ]])

    @property
    def _rate(self) -> float:
        return float(self._pitch_rate - self.mean[GYRO])

    def angles_and_rates_covariance(self) -> Array:
        """Of the errors of (pitch, joints, v, pitch rate, joint rates), shape (12, 12)."""
        select = np.zeros((12, SIZE))
        select[0, PITCH] = 1
        select[1:5, J], select[5:7, V], select[8:, DJ] = np.eye(4), np.eye(2), np.eye(4)
        select[7, GYRO] = -1
        covariance = select @ self.covariance @ select.T
        covariance[7, 7] += self.parameters.gyro_noise**2
        return covariance

    def _begin(self, sensors: BodySensors) -> None:
        p = self.parameters
        self._stance, self._standing, self._landed = Leg.LEFT, True, 0
        self._attitude, self._pitch_rate = sensors.attitude, sensors.pitch_rate
        self.innovation = None
        x = self.mean = np.zeros(SIZE)
        x[PITCH], x[J], x[DJ] = sensors.attitude, sensors.joint_angles, sensors.joint_rates
        x[P] = -foothold(x[PITCH], x[J], Leg.LEFT, p.foot_radius)
        jacobian = foothold_jacobian(x[PITCH], x[J], Leg.LEFT, p.foot_radius)
        x[V] = -jacobian @ np.concatenate([[self._rate], x[DJ]])
        std = np.zeros(SIZE)
        std[PITCH], std[J], std[DJ], std[DDJ] = p.attitude_error, p.angle_noise, p.rate_noise, p.first_acceleration
        std[GYRO], std[ACCELEROMETER], std[OFFSET] = p.gyro_bias, p.accelerometer_bias, p.encoder_offset
        to = np.eye(SIZE)  # of the independent errors of pitch, joints, their rates and the sensors to those of x
        to[P, PITCH], to[P, J] = -jacobian[:, 0], -jacobian[:, 1:]
        to[V, GYRO], to[V, DJ] = jacobian[:, 0], -jacobian[:, 1:]
        by_angles = foothold_rate_by_angles(x[PITCH], x[J], Leg.LEFT, self._rate, x[DJ])
        to[V, PITCH], to[V, J] = -by_angles[:, 0], -by_angles[:, 1:]
        to[J, OFFSET] = -np.eye(4)
        to[P, OFFSET], to[V, OFFSET] = jacobian[:, 1:], by_angles[:, 1:]
        independent = np.diag(std**2)
        hips = [OFFSET.start, OFFSET.start + 2]
        independent[np.ix_(hips, hips)] += p.bend**2  # links that are bent alike turn both hips alike
        self.covariance = to @ independent @ to.T
        self.covariance[V, V] += (p.foot_speed**2 + (0.8 * p.gyro_noise) ** 2) * np.eye(2)
        self.covariance[P, P] += p.foot_slide**2 * np.eye(2)

    def _predict(self, sensors: BodySensors) -> None:
        x, f = self.mean, self._f
        turned = sensors.attitude - self._attitude - x[GYRO] * DT
        pitch = x[PITCH] + turned / 2
        c, s = np.cos(pitch), np.sin(pitch)
        rotation = np.array([[c, s], [-s, c]])
        force = sensors.specific_force - x[ACCELEROMETER]
        gained = (rotation @ force + GRAVITY) * DT
        f[V, PITCH] = np.array([[-s, c], [-c, -s]]) @ force * DT
        f[V, ACCELEROMETER] = -rotation * DT
        f[P, PITCH], f[P, ACCELEROMETER] = f[V, PITCH] * DT / 2, f[V, ACCELEROMETER] * DT / 2
        x[P] += x[V] * DT + gained * DT / 2
        x[V] += gained
        x[PITCH] += turned
        x[J] += x[DJ] * DT + x[DDJ] * DT**2 / 2
        x[DJ] += x[DDJ] * DT
        self.covariance = f @ self.covariance @ f.T + self._q

    def _watch_feet(self, state: RobotState) -> bool:
        """Which foot stands, and whether it landed in this tick: the swing foot, or the stance foot after a hop."""
        p, swing, steps = self.parameters, self._stance.other, (state.tick - self._landed) * DT
        self._standing, stood = True, self._standing
        if state.contact[swing] and steps > p.least_step:
            self._stance = swing
        elif not state.contact[self._stance]:
            self._standing = False
        elif stood:
            if self._landed and state.tick - self._landed <= p.settling:
                self._shake(p.settling_rate)
            return False
        if self._standing:
            self._land(state.tick)
        return self._standing

    def _land(self, tick: int) -> None:
        """The stance foot's hold is where the legs say that it is; its impact may have changed every rate."""
        p, x, covariance = self.parameters, self.mean, self.covariance
        self._landed = tick
        self._shake(p.impact_rate)
        covariance[P, P] += p.impact_shift**2 * np.eye(2)
        covariance[V, V] += p.impact_speed**2 * np.eye(2)
        jacobian = foothold_jacobian(x[PITCH], x[J], self._stance, p.foot_radius)
        x[C] = x[P] + foothold(x[PITCH], x[J], self._stance, p.foot_radius)
        to = np.zeros((2, SIZE))
        to[:, P], to[:, PITCH], to[:, J] = np.eye(2), jacobian[:, 0], jacobian[:, 1:]
        covariance[C, :] = to @ covariance
        covariance[:, C] = covariance[C, :].T
        covariance[C, C] = to @ covariance @ to.T + p.landing_shift**2 * np.eye(2)

    def _shake(self, rate: float) -> None:
        """The joints' rates may have changed by `rate`, rad/s, in the tick; their accelerations are unknown."""
        x, covariance, eye = self.mean, self.covariance, np.eye(4)
        x[DDJ] = 0
        covariance[DDJ, :] = covariance[:, DDJ] = 0
        covariance[DDJ, DDJ] = self.parameters.first_acceleration**2 * eye
        covariance[J, J] += (rate * DT) ** 2 / 3 * eye  # a jump at any moment of the tick
        covariance[J, DJ] += rate**2 * DT / 2 * eye
        covariance[DJ, J] += rate**2 * DT / 2 * eye
        covariance[DJ, DJ] += rate**2 * eye

    def _correct(self, sensors: BodySensors, landed: bool) -> None:
        if not landed and self._innovation(sensors, slice(ENCODERS), landed)[0].nis > SURPRISE:
            self._shake(self.parameters.settling_rate)  # an impact that the feet did not tell
        rows = slice(None if self._standing else ENCODERS)  # nothing is known of a foot in the air
        innovation, h, noise = self._innovation(sensors, rows, landed)
        self.innovation = innovation
        gain = np.linalg.solve(innovation.covariance, h @ self.covariance).T
        self.mean = self.mean + gain @ innovation.value
        kept = np.eye(SIZE) - gain @ h
        covariance = kept @ self.covariance @ kept.T + gain @ noise @ gain.T
        self.covariance = (covariance + covariance.T) / 2

    def _innovation(self, sensors: BodySensors, rows: slice, landed: bool) -> tuple[Innovation, Array, Array]:
        """Of these rows; their derivative over x and their noise."""
        expected, h = (each[rows] for each in self._expect(sensors))
        noise = self._noise(landed)[rows, rows]
        measured = np.concatenate([sensors.joint_angles, sensors.joint_rates, np.zeros(4)])[rows]
        return Innovation(measured - expected, h @ self.covariance @ h.T + noise), h, noise

    def _expect(self, sensors: BodySensors) -> tuple[Array, Array]:
        """What should be measured, and its derivative over x: encoders, rates, the hold's place and speed."""
        p, x, stance = self.parameters, self.mean, self._stance
        turning = float(sensors.pitch_rate - x[GYRO])
        jacobian = self._jacobian = foothold_jacobian(x[PITCH], x[J], stance, p.foot_radius)
        by_angles = foothold_rate_by_angles(x[PITCH], x[J], stance, turning, x[DJ])
        angles, rates = x[J] + x[OFFSET], x[DJ] - p.rate_window / 2 * x[DDJ]
        place = x[P] + foothold(x[PITCH], x[J], stance, p.foot_radius) - x[C]
        speed = x[V] + jacobian @ np.concatenate([[turning], x[DJ]])
        h = np.zeros((ENCODERS + 4, SIZE))
        h[:4, J] = h[:4, OFFSET] = h[4:8, DJ] = np.eye(4)
        h[4:8, DDJ] = -p.rate_window / 2 * np.eye(4)
        h[8:10, P], h[8:10, C], h[10:, V] = np.eye(2), -np.eye(2), np.eye(2)
        h[8:10, PITCH], h[8:10, J] = jacobian[:, 0], jacobian[:, 1:]
        h[10:, PITCH], h[10:, J] = by_angles[:, 0], by_angles[:, 1:]
        h[10:, GYRO], h[10:, DJ] = -jacobian[:, 0], jacobian[:, 1:]
        return np.concatenate([angles, rates, place, speed]), h

    def _noise(self, landed: bool) -> Array:
        """Covariance of what is measured."""
        p, eye = self.parameters, np.eye(4)
        noise = np.diag([p.angle_noise**2] * 4 + [p.rate_noise**2] * 4 + [p.foot_slide**2] * 2 + [p.foot_speed**2] * 2)
        # a rate is taken between two rounded angles; the later one is the angle that is measured
        noise[:4, 4:8] = noise[4:8, :4] = p.angle_noise**2 / p.rate_window * eye
        noise[10:, 10:] += p.gyro_noise**2 * np.outer(self._jacobian[:, 0], self._jacobian[:, 0])
        if landed:  # the foot may still be coming to rest, and a rate be from before and after the impact
            noise[10:, 10:] += p.landing_speed**2 * np.eye(2)
            noise[4:8, 4:8] += p.landing_rate**2 * eye
        return noise


def process_noise(p: EstimatorParameters) -> Array:
    """What a tick adds to the covariance (26, 26)."""
    noise = np.zeros((SIZE, SIZE))
    v = (p.accelerometer_noise * DT) ** 2 + p.impulse_speed**2
    noise[V, V], noise[P, P] = v * np.eye(2), v * DT**2 / 3 * np.eye(2)
    noise[PITCH, PITCH] = (p.gyro_noise * DT) ** 2
    order = np.arange(3)[::-1]  # of the integrals of white noise that angle, rate and acceleration are
    total = order[:, None] + order + 1
    factorials = np.array([2.0, 1.0, 1.0])
    wandering = p.jerk**2 * DT**total / (total * np.outer(factorials, factorials))
    for joint in range(4):
        at = np.array([J.start, DJ.start, DDJ.start]) + joint
        noise[np.ix_(at, at)] = wandering
    noise[C, C] = p.foot_roll**2 * np.eye(2)
    return noise


def check(sensors: BodySensors, tick: int) -> None:
    """Refuse what is not finite; tick 0 has no specific force."""
    for name in ("joint_angles", "joint_rates", "attitude", "pitch_rate", "specific_force")[: 4 if tick == 0 else 5]:
        value = getattr(sensors, name)
        if not np.isfinite(value).all():
            raise EstimatorError(f"sensors.{name} = {value}: expected finite numbers")
