"""The state of a planar biped from its own sensors: a contact-aided extended Kalman filter.

After Bloesch et al., "State estimation for legged robots: consistent fusion of leg kinematics and IMU" (RSS 2012), in
the plane, with the joints' rates, the encoders' zeros and the ground's compliance among what is estimated. It knows the
lengths of the links and no mass, so it does not care what the true masses are.

    x = (p, v, pitch, j, j', j'', c, b_g, b_a, o, s, n)

    p, v    hip, world: position, velocity          b_g    constant error of the gyro
    pitch   of the torso                            b_a    of the accelerometer, torso frame
    j       the four joint angles                   o      of the encoders
    j', j'' their rates and accelerations           s      compliance: how far a foot sinks for a force, m/N
    c       stance foot's hold, unloaded, world     n      the gyro's noise in this tick

The IMU moves the hip from tick to tick: its attitude turns the torso, its specific force f changes the velocity,
v+ = v + (R(pitch) (f - b_a) - g) dt. The joints move on with their accelerations, which wander; a shock, which is a
change of f, may change their rates and accelerations at any moment of the tick. Measured are the encoders' angles
j + o, their drives' rates j' - lag j'', and where the stance foot stands:

    p + leg(pitch, j) = c - s F e_z,    v + d/dt leg(pitch, j) = -s F' e_z,    F' = (measured force - F) / sinking time

It sinks under the load F, which lags behind the measured force as rubber with damping does. When the swing foot
touches down, it becomes the stance foot: c is where the legs say that it is.
"""

from collections.abc import Iterator
from dataclasses import replace
from itertools import accumulate, pairwise

import numpy as np
from rabbit_description.state import JOINTS, TICK_SECONDS, Array, BodySensors, Leg, RobotState

from rabbit_estimator.encoder_gate import EncoderGate, Innovation
from rabbit_estimator.leg_kinematics import foothold, foothold_jacobian, foothold_rate_by_angles
from rabbit_estimator.parameters import EstimatorParameters

GRAVITY = np.array([0.0, -9.81])


def spans(first: int, *sizes: int) -> Iterator[slice]:
    """Slices of these sizes, one after the other."""
    return (slice(*ends) for ends in pairwise(accumulate(sizes, initial=first)))


P, V = spans(0, 2, 2)
PITCH = V.stop
J, DJ, DDJ, C = spans(PITCH + 1, JOINTS, JOINTS, JOINTS, 2)
GYRO = C.stop
ACCELEROMETER, OFFSET = spans(GYRO + 1, 2, JOINTS)
COMPLIANCE = OFFSET.stop
GYRO_NOISE = COMPLIANCE + 1
SIZE = GYRO_NOISE + 1
ANGLES, RATES, PLACE, SPEED = spans(0, JOINTS, JOINTS, 2, 2)  # what is measured
MEASURED = SPEED.stop
ENCODERS = slice(RATES.stop)  # without the ground
EACH = np.eye(JOINTS)
LOST_OFFSET, LOST_RATE = 1.0, 10.0  # rad, rad/s: more error of a joint that the gate has refused for long


class EstimatorError(ValueError):
    """What the filter was given cannot be used."""


class LostError(EstimatorError):
    """Nothing is known of the state any more: the numbers are too large to go on with."""


class ContactAidedFilter:
    """One robot's state, tick by tick: `update` takes what its sensors say and fills in `q` and `dq`.

    `mean` (28,) and `covariance` (28, 28) of x; `innovation` of the last tick, None at tick 0.
    """

    _feet: RobotState

    def __init__(self, parameters: EstimatorParameters) -> None:
        self.parameters = parameters
        self._f, self._h = constant_transition(parameters.tick_seconds), constant_derivatives(parameters)
        self._wandering, self._noise = process_noise(parameters), measurement_noise(parameters)
        self._shaken = [shock_noise(parameters, stance) for stance in Leg]
        self._sinking = 1 - np.exp(-parameters.tick_seconds / parameters.sinking_time)
        self._settles = parameters.settling ** (parameters.tick_seconds / TICK_SECONDS)
        self.innovation: Innovation | None = None
        self._tick = -1

    def update(self, state: RobotState) -> RobotState:
        """The state with `q`, `dq` estimated; tick 0 begins a new episode, the left foot at rest at (0, 0).

        Raises:
            EstimatorError: no sensors in it, numbers that are not finite, or not the tick after the last one.
            LostError: numbers that are finite, and too large.
        """
        try:
            found = self._updated(state)
        except np.linalg.LinAlgError as error:
            raise LostError(f"the estimator cannot go on: {error}") from error
        if not np.isfinite([*found.q, *found.dq]).all():
            raise LostError(f"the estimator cannot go on: q = {found.q}, dq = {found.dq}: expected finite numbers")
        return found

    def _updated(self, state: RobotState) -> RobotState:
        sensors, p = state.sensors, self.parameters
        if sensors is None:
            raise EstimatorError("state.sensors = None: expected encoders and IMU, as the simulator's sensors lab give")
        check(sensors, state.tick)
        if state.tick == 0:
            self._begin(sensors)
        elif state.tick != self._tick + 1:
            raise EstimatorError(f"state.tick = {state.tick}: expected {self._tick + 1}, or 0 for a new episode")
        else:
            shock = self._predict(sensors)
            self._watch_feet(self._feet if p.sensor_delay else state)  # late readings do not show a landing yet
            self._correct(sensors, shock)
        self._feet = state
        self._tick, self._attitude, self._pitch_rate = state.tick, sensors.attitude, sensors.pitch_rate
        return replace(state, q=self.q, dq=self.dq)

    @property
    def q(self) -> Array:
        """Estimated coordinates (7,), m, rad. Those of late readings go on at their rates; accelerations do harm."""
        x = self.mean
        return np.concatenate([x[P], x[PITCH : PITCH + 1], x[J]]) + self.parameters.sensor_delay * self.dq

    @property
    def dq(self) -> Array:
        """Estimated rates (7,) when the sensors were read, m/s, rad/s."""
        x = self.mean
        return np.concatenate([x[V], [self._rate], x[DJ]])

    @property
    def _rate(self) -> float:
        return float(self._pitch_rate - self.mean[GYRO] - self.mean[GYRO_NOISE])

    def angles_and_rates_covariance(self) -> Array:
        """Of the errors of (pitch, joints, v, pitch rate, joint rates) when the sensors were read, shape (12, 12)."""
        joints, v = spans(1, JOINTS, 2)
        rate = v.stop
        select = np.zeros((rate + 1 + JOINTS, SIZE))
        select[0, PITCH] = 1
        select[joints, J], select[v, V], select[rate + 1 :, DJ] = EACH, np.eye(2), EACH
        select[rate, [GYRO, GYRO_NOISE]] = -1
        return select @ self.covariance @ select.T

    def _begin(self, sensors: BodySensors) -> None:
        p = self.parameters
        self._stance, self._standing, self._landed = Leg.LEFT, True, 0
        self._load = self._push = self._unsettled = 0.0
        self._gate = EncoderGate(p.tick_seconds)
        self._attitude, self._pitch_rate = sensors.attitude, sensors.pitch_rate
        self.innovation = None
        x = self.mean = np.zeros(SIZE)
        x[PITCH], x[J], x[DJ], x[COMPLIANCE] = sensors.attitude, sensors.joint_angles, sensors.joint_rates, p.compliance
        x[P] = -foothold(x[PITCH], x[J], Leg.LEFT, p.foot_radius)
        jacobian = foothold_jacobian(x[PITCH], x[J], Leg.LEFT, p.foot_radius)
        x[V] = -jacobian @ np.concatenate([[self._rate], x[DJ]])
        self._force = -turn(x[PITCH]).T @ GRAVITY
        std = np.zeros(SIZE)
        std[PITCH], std[J], std[DJ], std[DDJ] = p.attitude_error, p.angle_noise, p.rate_noise, p.first_acceleration
        std[GYRO], std[ACCELEROMETER], std[OFFSET] = p.gyro_bias, p.accelerometer_bias, p.encoder_offset
        std[COMPLIANCE], std[GYRO_NOISE] = p.compliance_error, p.gyro_noise
        to = np.eye(SIZE)  # of the independent errors of pitch, joints, their rates and the sensors to those of x
        to[P, PITCH], to[P, J] = -jacobian[:, 0], -jacobian[:, 1:]
        to[V, GYRO] = to[V, GYRO_NOISE] = jacobian[:, 0]
        by_angles = foothold_rate_by_angles(x[PITCH], x[J], Leg.LEFT, self._rate, x[DJ])
        to[V, PITCH], to[V, J], to[V, DJ] = -by_angles[:, 0], -by_angles[:, 1:], -jacobian[:, 1:]
        to[J, OFFSET] = -EACH
        to[P, OFFSET], to[V, OFFSET] = jacobian[:, 1:], by_angles[:, 1:]
        independent = np.diag(std**2)
        hips = [OFFSET.start, OFFSET.start + 2]
        independent[np.ix_(hips, hips)] += p.bend**2  # links that are bent alike turn both hips alike
        self.covariance = to @ independent @ to.T
        self.covariance[V, V] += p.first_speed**2 * np.eye(2)
        self.covariance[P, P] += p.foot_slide**2 * np.eye(2)

    def _predict(self, sensors: BodySensors) -> float:
        """Go on for a tick; returns the shock in it squared, (m/s^2)^2: what f changed by more than its noise."""
        p, x, f, dt = self.parameters, self.mean, self._f, self.parameters.tick_seconds
        turned = sensors.attitude - self._attitude - x[GYRO] * dt
        rotation = turn(x[PITCH] + turned / 2)
        force = sensors.specific_force - x[ACCELEROMETER]
        pushed = rotation @ force
        gained = (pushed + GRAVITY) * dt
        f[V, PITCH] = pushed[1] * dt, -pushed[0] * dt
        f[V, ACCELEROMETER] = -rotation * dt
        f[P, PITCH], f[P, ACCELEROMETER] = f[V, PITCH] * dt / 2, f[V, ACCELEROMETER] * dt / 2
        x[P] += x[V] * dt + gained * dt / 2
        x[V] += gained
        x[PITCH] += turned
        x[J] += x[DJ] * dt + x[DDJ] * dt**2 / 2
        x[DJ] += x[DDJ] * dt
        x[GYRO_NOISE] = 0
        change = sensors.specific_force - self._force
        self._force = sensors.specific_force
        shock = max(float(change @ change) - 4 * p.accelerometer_noise**2, 0.0)
        self.covariance = f @ self.covariance @ f.T + self._wandering + shock * self._shaken[self._stance]
        return shock

    def _watch_feet(self, state: RobotState) -> None:
        """Which foot stands, since when, and under which load: the swing foot lands, or the stance foot after a hop."""
        p, swing = self.parameters, self._stance.other
        steps = (state.tick - self._landed) * p.tick_seconds
        self._standing, stood = True, self._standing
        self._unsettled *= self._settles
        if state.contact[swing] and steps > p.least_step:
            self._stance = swing
            self._land(state.tick)
        elif not state.contact[self._stance]:
            self._standing = False
            return
        elif not stood:
            self._land(state.tick)
        force = float(state.foot_force[self._stance, 1])  # the tick's mean; at its end it has changed by half as much
        end = force if self._landed == state.tick else force + (force - self._push) / 2
        self._load += (force - self._load) * self._sinking
        self._loading, self._push = (end - self._load) / p.sinking_time, force

    def _land(self, tick: int) -> None:
        """The stance foot's hold is where the legs say that it is, and nothing loads it yet."""
        p, x, covariance = self.parameters, self.mean, self.covariance
        self._landed, self._load, self._push, self._unsettled = tick, 0.0, 0.0, p.landing_speed
        jacobian = foothold_jacobian(x[PITCH], x[J], self._stance, p.foot_radius)
        x[C] = x[P] + foothold(x[PITCH], x[J], self._stance, p.foot_radius)
        to = np.zeros((2, SIZE))
        to[:, P], to[:, PITCH], to[:, J] = np.eye(2), jacobian[:, 0], jacobian[:, 1:]
        covariance[C, :] = to @ covariance
        covariance[:, C] = covariance[C, :].T
        covariance[C, C] = to @ covariance @ to.T + p.landing_shift**2 * np.eye(2)

    def _correct(self, sensors: BodySensors, shock: float) -> None:
        p, dt = self.parameters, self.parameters.tick_seconds
        rows = slice(None) if self._standing else ENCODERS  # nothing is known of a foot in the air
        noise = self._noise.copy()
        noise[RATES, RATES] += (p.shock_measured * dt) ** 2 * shock * EACH
        noise[SPEED, SPEED] += (self._unsettled**2 + (p.shock_foot * dt) ** 2 * shock) * np.eye(2)
        self.covariance[C, C] += (self._unsettled * dt) ** 2 * np.eye(2)
        measured = np.concatenate([sensors.joint_angles, sensors.joint_rates, np.zeros(MEASURED - RATES.stop)])
        value = (measured - self._expect(sensors))[rows]
        h = self._h[rows]
        across = h @ self.covariance
        innovation = Innovation(value, across @ h.T + noise[rows, rows])
        accepted = self._gate.accepted(innovation)
        if not accepted.all():
            across = across[accepted]
            innovation = Innovation(value[accepted], innovation.covariance[np.ix_(accepted, accepted)])
        self.innovation = innovation
        gain = np.linalg.solve(innovation.covariance, across).T
        self.mean = self.mean + gain @ innovation.value
        covariance = self.covariance - gain @ across
        self.covariance = (covariance + covariance.T) / 2
        for joint in self._gate.lost():
            for at, std in ((OFFSET, LOST_OFFSET), (DJ, LOST_RATE)):
                self.covariance[at.start + joint, at.start + joint] += std**2

    def _expect(self, sensors: BodySensors) -> Array:
        """What should be measured; puts its derivative over x into `_h`."""
        p, x, h, stance = self.parameters, self.mean, self._h, self._stance
        turning = float(sensors.pitch_rate - x[GYRO])
        jacobian = foothold_jacobian(x[PITCH], x[J], stance, p.foot_radius)
        by_angles = foothold_rate_by_angles(x[PITCH], x[J], stance, turning, x[DJ])
        angles, rates = x[J] + x[OFFSET], x[DJ] - p.rate_window / 2 * x[DDJ]
        place = x[P] + foothold(x[PITCH], x[J], stance, p.foot_radius) - x[C]
        speed = x[V] + jacobian @ np.concatenate([[turning], x[DJ]])
        if self._standing:
            h[PLACE, COMPLIANCE], h[SPEED, COMPLIANCE] = (0.0, self._load), (0.0, self._loading)
            place[1] += x[COMPLIANCE] * self._load
            speed[1] += x[COMPLIANCE] * self._loading
        h[PLACE, PITCH], h[PLACE, J] = jacobian[:, 0], jacobian[:, 1:]
        h[SPEED, PITCH], h[SPEED, J], h[SPEED, DJ] = by_angles[:, 0], by_angles[:, 1:], jacobian[:, 1:]
        h[SPEED, GYRO] = h[SPEED, GYRO_NOISE] = -jacobian[:, 0]
        return np.concatenate([angles, rates, place, speed])


def turn(pitch: float) -> Array:
    """From the torso's frame to the world's, (2, 2)."""
    c, s = np.cos(pitch), np.sin(pitch)
    return np.array([[c, s], [-s, c]])


def constant_transition(dt: float) -> Array:
    """Derivative of x over the last tick's, `dt` s before, (28, 28), without what depends on x."""
    f = np.eye(SIZE)
    f[P, V], f[PITCH, GYRO] = dt * np.eye(2), -dt
    f[J, DJ] = f[DJ, DDJ] = dt * EACH
    f[J, DDJ] = dt**2 / 2 * EACH
    f[GYRO_NOISE, GYRO_NOISE] = 0  # each tick has its own
    return f


def constant_derivatives(p: EstimatorParameters) -> Array:
    """Of what is measured over x, (12, 28), without what depends on x."""
    h = np.zeros((MEASURED, SIZE))
    h[ANGLES, J] = h[ANGLES, OFFSET] = h[RATES, DJ] = EACH
    h[RATES, DDJ] = -p.rate_window / 2 * EACH
    h[PLACE, P], h[PLACE, C], h[SPEED, V] = np.eye(2), -np.eye(2), np.eye(2)
    return h


def measurement_noise(p: EstimatorParameters) -> Array:
    """Covariance of what is measured, (12, 12), in a tick without a shock."""
    encoders = [p.angle_noise**2] * JOINTS + [p.rate_noise**2] * JOINTS
    noise = np.diag(encoders + [p.foot_slide**2] * 2 + [p.foot_speed**2] * 2)
    # a rate is taken between two rounded angles; the later one is the angle that is measured
    noise[ANGLES, RATES] = noise[RATES, ANGLES] = p.angle_noise**2 / p.rate_window * EACH
    return noise


def process_noise(p: EstimatorParameters) -> Array:
    """What a tick without a shock adds to the covariance, (28, 28)."""
    noise, dt = np.zeros((SIZE, SIZE)), p.tick_seconds
    v = (p.accelerometer_noise * dt) ** 2
    noise[V, V], noise[P, P] = v * np.eye(2), v * dt**2 / 3 * np.eye(2)
    noise[PITCH, PITCH], noise[GYRO_NOISE, GYRO_NOISE] = (p.gyro_noise * dt) ** 2, p.gyro_noise**2
    order = np.arange(3)[::-1]  # of the integrals of white noise that angle, rate and acceleration are
    total = order[:, None] + order + 1
    factorials = np.array([2.0, 1.0, 1.0])
    wandering = p.jerk**2 * dt**total / (total * np.outer(factorials, factorials))
    for joint in range(JOINTS):
        at = np.array([J.start, DJ.start, DDJ.start]) + joint
        noise[np.ix_(at, at)] = wandering
    noise[C, C] = p.foot_roll**2 * (dt / TICK_SECONDS) * np.eye(2)  # a random walk
    return noise


def shock_noise(p: EstimatorParameters, stance: Leg) -> Array:
    """What a shock of 1 m/s^2 adds, (28, 28): at an unknown moment of the tick it changes rates and accelerations."""
    noise, dt = np.zeros((SIZE, SIZE)), p.tick_seconds
    noise[P, P], noise[V, V] = dt**4 / 12 * np.eye(2), (p.shock_speed * dt) ** 2 * np.eye(2)
    for joint in range(JOINTS):
        more = 1.0 if joint // 2 == stance else p.swing_shock
        at = np.array([J.start, DJ.start]) + joint
        jump = np.array([[dt**2 / 3, dt / 2], [dt / 2, 1]])
        noise[np.ix_(at, at)] = (more * p.shock_rate * dt) ** 2 * jump
        noise[DDJ.start + joint, DDJ.start + joint] = (more * p.shock_acceleration) ** 2
    return noise


def check(sensors: BodySensors, tick: int) -> None:
    """Refuse what is not finite; tick 0 has no specific force."""
    names = ("joint_angles", "joint_rates", "attitude", "pitch_rate", "specific_force")
    for name in names[:-1] if tick == 0 else names:
        value = getattr(sensors, name)
        if not np.isfinite(value).all():
            raise EstimatorError(f"sensors.{name} = {value}: expected finite numbers")
