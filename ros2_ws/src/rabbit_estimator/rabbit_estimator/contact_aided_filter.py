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

A tick is one function of rows of numbers, `estimate_state`, from memory, sensors and settings to memory, state and
report. What is below `begun` is its expressions: m, s, p are memory, sensors and parameters by name.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from functools import cache
from itertools import accumulate, pairwise
from math import factorial, sqrt
from threading import get_ident
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
from cbf_clf_qp.functions import Layout, NumpyFunction, Place, is_finite, one_at_a_time, symmetric
from rabbit_description.planar_urdf import SLIDES
from rabbit_description.state import FEET, JOINTS, LEG_JOINTS, TICK_SECONDS, Array, BodySensors, RobotState

from rabbit_estimator.encoder_gate import is_accepted, is_lost
from rabbit_estimator.leg_kinematics import foothold, foothold_rate
from rabbit_estimator.parameters import EstimatorParameters

GRAVITY = ca.DM([0.0, -9.81])


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
LOST_OFFSET, LOST_RATE = 1.0, 10.0  # rad, rad/s: more error of a joint that the gate has refused for long


PLANE, EACH = ca.SX.eye(SLIDES), ca.SX.eye(JOINTS)

BODY = {"joint_angles": JOINTS, "joint_rates": JOINTS, "attitude": 1, "pitch_rate": 1, "specific_force": SLIDES}
GROUND = {"foot_force": len(FEET) * SLIDES, "contact": len(FEET)}
MEMORY = Layout(
    {"tick": 1, "mean": SIZE, "covariance": SIZE**2, "stance": 1, "standing": 1, "landed": 1, "load": 1, "push": 1}
    | {"unsettled": 1, "refusals": JOINTS, "attitude": 1, "specific_force": SLIDES, **GROUND}
)
SENSORS = Layout({"tick": 1, **GROUND, **BODY})
SETTINGS = Layout(dict.fromkeys(EstimatorParameters.model_fields, 1))
REFUSALS = *BODY, "tick (not the next)", "state (lost)"  # from 1: of BODY what is not finite
NOT_NEXT, LOST = len(BODY) + 1, len(BODY) + 2


class EstimatorError(ValueError):
    """What the filter was given cannot be used."""


class LostError(EstimatorError):
    """Nothing is known of the state any more: the numbers are too large to go on with."""


class ContactAidedFilter:
    """One robot's state, tick by tick: `update` takes what its sensors say and fills in `q` and `dq`.

    `settings`: the parameters as a row. `belief`: what `estimate_state` gave of the last tick, from `tick`, -1 before
    the first, to `refused`. One filter serves one thread.
    """

    def __init__(self, parameters: EstimatorParameters) -> None:
        self.settings = np.array([getattr(parameters, name) for name in SETTINGS.places])
        self.belief = estimate_state().values(np.zeros(estimate_state().row.size))
        self.belief.tick[:] = -1

    def update(self, state: RobotState) -> RobotState:
        """The state with `q`, `dq` estimated; tick 0 begins a new episode, the left foot at rest at (0, 0).

        Raises:
            EstimatorError: no sensors in it, numbers that are not finite, or not the tick after the last one.
            LostError: numbers that are finite, and too large.
        """
        sensors = state.sensors
        if sensors is None:
            raise EstimatorError("state.sensors = None: expected encoders and IMU, as the simulator's sensors lab give")
        belief = estimate_state()(self.belief.row[: MEMORY.size], sensors_row(state, sensors), self.settings)
        refused = int(belief.refused[0])
        if refused == LOST:
            raise LostError(f"the estimator cannot go on: q = {belief.q}, dq = {belief.dq}: expected finite numbers")
        if refused == NOT_NEXT:
            expected = f"{self.belief.tick[0] + 1:g}, or 0 for a new episode"
            raise EstimatorError(f"state.tick = {state.tick}: expected {expected}")
        if refused:
            name = [*BODY][refused - 1]
            raise EstimatorError(f"sensors.{name} = {getattr(sensors, name)}: expected finite numbers")
        self.belief = belief
        return replace(state, q=belief.q, dq=belief.dq)

    def angles_and_rates_covariance(self) -> Array:
        """The errors' covariance (12, 12) of (pitch, joints, v, pitch rate, joint rates) when the sensors were read."""
        select = np.eye(SIZE)[np.r_[PITCH, J, V, GYRO, DJ]]
        select[1 + JOINTS + SLIDES, [GYRO, GYRO_NOISE]] = -1
        return select @ self.belief.covariance @ select.T


def sensors_row(state: RobotState, sensors: BodySensors) -> Array:
    """`SENSORS` of a tick."""
    said = (getattr(sensors, name) for name in BODY)
    return np.hstack([state.tick, state.foot_force.ravel(), state.contact, *said])


def estimate_state() -> NumpyFunction:
    """The function of `MEMORY`, `SENSORS` and `SETTINGS` that gives `MEMORY` after the tick, `q`, `dq` and a report.

    The report is `nis`, the normalised innovation squared, of so many numbers `measured`, and `refused`: 0, or why the
    tick does not count. Tick 0 begins an episode. Each thread has one of its own.
    """
    return _of_thread(get_ident())


@cache
@one_at_a_time
def _of_thread(_: int) -> NumpyFunction:
    return NumpyFunction(*estimation())


@cache
@one_at_a_time
def estimation() -> tuple[ca.Function, Mapping[str, Place]]:
    """`estimate_state` and the places of its outputs."""
    rows = {"memory": MEMORY, "sensors": SENSORS, "settings": SETTINGS}
    symbols = {name: ca.SX.sym(name, layout.size) for name, layout in rows.items()}
    named = [SimpleNamespace(**layout.parts(symbols[name])) for name, layout in rows.items()]
    begin, go_on = (NumpyFunction.of(function.__name__, symbols, function(*named)) for function in (begun, gone_on))
    either = ca.Function.if_else("either", begin.function, go_on.function)
    given = [ca.MX.sym(name, layout.size) for name, layout in rows.items()]
    belief = either(SENSORS.parts(given[1])["tick"] == 0, *given)
    return ca.Function("estimate_state", given, [belief], [*rows], ["values"]), begin.places


def begun(_: Any, s: Any, p: Any) -> dict[str, Any]:
    """What is found at tick 0."""

    def first(error: ca.SX) -> ca.SX:
        """x of independent errors, of pitch, joints, rates and sensors, each at its place in x."""
        x = ca.SX(error)
        x[PITCH], x[J] = s.attitude + error[PITCH], s.joint_angles + error[J] - error[OFFSET]
        x[DJ], x[COMPLIANCE] = s.joint_rates + error[DJ], p.compliance + error[COMPLIANCE]
        left = x[PITCH], x[J], 0, p.foot_radius
        x[P], x[V] = error[P] - foothold(*left), error[V] - foothold_rate(*left, turning(x, s), x[DJ])
        return x

    x, to = linearised(first, ca.SX.zeros(SIZE))
    std = ca.SX.zeros(SIZE)
    std[P], std[V], std[PITCH], std[J] = p.foot_slide, p.first_speed, p.attitude_error, angle_noise(p)
    std[DJ], std[DDJ], std[OFFSET] = rate_noise(p), p.first_acceleration, p.encoder_offset
    std[GYRO], std[ACCELEROMETER], std[GYRO_NOISE] = p.gyro_bias, p.accelerometer_bias, p.gyro_noise
    std[COMPLIANCE] = p.compliance_error
    independent, hips = ca.diag(std**2), slice(OFFSET.start, OFFSET.stop, LEG_JOINTS)
    independent[hips, hips] += p.bend**2  # links that are bent alike turn both hips alike
    kept = {"mean": x, "covariance": symmetric(to @ independent @ to.T), "standing": 1.0}
    kept["specific_force"] = -turn(x[PITCH]).T @ GRAVITY
    return answer(s, p, kept, [*BODY][:-1], 0)


def gone_on(m: Any, s: Any, p: Any) -> dict[str, Any]:
    """What is found at another tick."""
    x, covariance, shock = predicted(m, s, p)
    feet = watched(m, s, p)
    hold, to = linearised(lambda x: x[P] + foothold(x[PITCH], x[J], feet.stance, p.foot_radius), x)
    x[C] = ca.if_else(feet.lands, hold, x[C])
    across = ca.if_else(feet.lands, to @ covariance, covariance[C, :])
    across[:, C] = ca.if_else(feet.lands, to @ covariance @ to.T + p.landing_shift**2 * PLANE, covariance[C, C])
    covariance[C, :], covariance[:, C] = across, across.T
    kept, nis, measured = corrected(x, covariance, shock, feet, m, s, p)
    kept |= {name: value for name, value in vars(feet).items() if name in MEMORY.sizes}
    refused = ca.if_else(s.tick == m.tick + 1, 0, NOT_NEXT)
    return answer(s, p, kept, BODY, refused, nis, measured)


def predicted(m: Any, s: Any, p: Any) -> tuple[ca.SX, ca.SX, ca.SX]:
    """x and its covariance a tick on, and the shock in it squared, (m/s^2)^2: what f changed by more than its noise."""
    dt, turned = p.tick_seconds, s.attitude - m.attitude

    def moved(x: ca.SX) -> ca.SX:
        middle = x[PITCH] + (turned - m.mean[GYRO] * dt) / 2  # how the gyro's error turns f is left out
        gained = (turn(middle) @ (s.specific_force - x[ACCELEROMETER]) + GRAVITY) * dt
        new = ca.SX(x)
        new[P], new[V] = x[P] + x[V] * dt + gained * dt / 2, x[V] + gained
        new[PITCH] = x[PITCH] + turned - x[GYRO] * dt
        new[J], new[DJ] = x[J] + x[DJ] * dt + x[DDJ] * dt**2 / 2, x[DJ] + x[DDJ] * dt
        new[GYRO_NOISE] = 0  # each tick has its own
        return new

    x, f = linearised(moved, m.mean)
    change = s.specific_force - m.specific_force
    shock = ca.fmax(ca.dot(change, change) - 4 * p.accelerometer_noise**2, 0)
    covariance = symmetric(ca.reshape(m.covariance, SIZE, SIZE))
    noise = process_noise(p) + shock * shock_noise(m.stance, p)
    return x, symmetric(f @ covariance @ f.T + noise), shock


def watched(m: Any, s: Any, p: Any) -> Any:
    """Which foot stands, since when, and under which load: the swing foot lands, or the stance foot after a hop."""
    is_late = p.sensor_delay > 0  # late readings do not show a landing yet
    ground = (m.tick, s.tick), (m.contact, s.contact), (m.foot_force, s.foot_force)
    tick, contact, force = (ca.if_else(is_late, *pair) for pair in ground)
    is_down = ca.if_else(m.stance, contact, contact[[1, 0]])  # of the swing and the stance foot
    steps = ca.logic_and(is_down[0], (tick - m.landed) * p.tick_seconds > p.least_step)
    stance, standing = ca.if_else(steps, 1 - m.stance, m.stance), ca.logic_or(steps, is_down[1])
    lands = ca.logic_or(steps, ca.logic_and(standing, ca.logic_not(m.standing)))
    landed, load, push = (ca.if_else(lands, *pair) for pair in ((tick, m.landed), (0, m.load), (0, m.push)))
    settled = m.unsettled * p.settling ** (p.tick_seconds / TICK_SECONDS)
    normal = ca.if_else(stance, force[3], force[1])  # the tick's mean; at its end it has changed by half as much
    end = ca.if_else(landed == tick, normal, normal + (normal - push) / 2)
    loaded = load + (normal - load) * (1 - ca.exp(-p.tick_seconds / p.sinking_time))
    return SimpleNamespace(
        stance=stance,
        standing=standing,
        lands=lands,
        landed=landed,
        load=ca.if_else(standing, loaded, load),
        loading=(end - loaded) / p.sinking_time,
        push=ca.if_else(standing, normal, push),
        unsettled=ca.if_else(lands, p.landing_speed, settled),
    )


def corrected(
    x: ca.SX, covariance: ca.SX, shock: ca.SX, feet: Any, m: Any, s: Any, p: Any
) -> tuple[dict[str, Any], ca.SX, ca.SX]:
    """What is kept of x, its covariance and the gate; the normalised innovation squared, of how many numbers."""
    dt = p.tick_seconds

    def expected(x: ca.SX) -> ca.SX:
        leg, sinks = (x[PITCH], x[J], feet.stance, p.foot_radius), x[COMPLIANCE]
        place = x[P] + foothold(*leg) - x[C] + ca.vertcat(0, sinks * feet.load)
        speed = x[V] + foothold_rate(*leg, turning(x, s), x[DJ]) + ca.vertcat(0, sinks * feet.loading)
        return ca.vertcat(x[J] + x[OFFSET], x[DJ] - p.rate_window / 2 * x[DDJ], place, speed)

    value, h = linearised(expected, x)
    value = ca.vertcat(s.joint_angles, s.joint_rates, 0, 0, 0, 0) - value
    noise = measurement_noise(p)
    noise[RATES, RATES] += (p.shock_measured * dt) ** 2 * shock * EACH
    noise[SPEED, SPEED] += (feet.unsettled**2 + (p.shock_foot * dt) ** 2 * shock) * PLANE
    covariance[C, C] += (feet.unsettled * dt) ** 2 * PLANE
    across = h @ covariance
    spread = across @ h.T + noise
    pairs = [[joint, JOINTS + joint] for joint in range(JOINTS)]
    accepted = ca.vertcat(*(is_accepted(value[a], value[b], spread[[a, b], [a, b]]) for a, b in pairs))
    used = ca.vertcat(accepted, accepted, *[feet.standing] * 2 * SLIDES)  # nothing is known of a foot in the air
    value, across = ca.if_else(used, value, 0), ca.if_else(ca.repmat(used, 1, SIZE), across, 0)
    spread = ca.if_else(used @ used.T, spread, ca.SX.eye(MEASURED))
    root = ca.chol(spread).T
    across, value = ca.solve(root, across), ca.solve(root, value)
    covariance = symmetric(covariance - across.T @ across)
    refusals = ca.if_else(accepted, 0, m.refusals + 1)
    lost = is_lost(refusals, dt)
    for place, std in ((OFFSET, LOST_OFFSET), (DJ, LOST_RATE)):
        covariance[place, place] += ca.diag(ca.if_else(lost, std**2, 0))
    kept = {"mean": x + across.T @ value, "covariance": covariance, "refusals": refusals}
    return kept, ca.dot(value, value), ca.sum1(used)


def answer(
    s: Any, p: Any, kept: dict[str, Any], needed: Iterable[str], refused: Any, nis: Any = 0, measured: Any = 0
) -> dict[str, Any]:
    """All that a tick gives; `kept` lacks what is zero or what the sensors say. `needed` must be finite."""
    x = kept["mean"]
    dq = ca.vertcat(x[V], turning(x, s), x[DJ])  # when the sensors were read
    q = ca.vertcat(x[P], x[PITCH], x[J]) + p.sensor_delay * dq  # on at these rates; accelerations do harm
    for code, name in reversed([*enumerate(needed, 1)]):
        refused = ca.if_else(is_finite(getattr(s, name)), refused, code)
    refused = ca.if_else(refused, refused, ca.if_else(is_finite(ca.vertcat(q, dq)), 0, LOST))
    rest = {name: getattr(s, name, ca.SX.zeros(size)) for name, size in MEMORY.sizes.items()}
    belief = rest | kept | {"q": q, "dq": dq, "nis": nis, "measured": measured, "refused": refused}
    return {name: ca.SX(value) for name, value in belief.items()}


def linearised(function: Callable[[ca.SX], ca.SX], x: ca.SX) -> tuple[ca.SX, ca.SX]:
    """The function's value and its derivative at x."""
    at = ca.SX.sym("at", x.numel())
    value = function(at)
    value, derivative = ca.substitute([value, ca.jacobian(value, at)], [at], [x])
    return value, derivative


def turning(x: ca.SX, s: Any) -> ca.SX:
    """The torso's rate."""
    return s.pitch_rate - x[GYRO] - x[GYRO_NOISE]


def turn(pitch: ca.SX) -> ca.SX:
    """The rotation from the torso's frame to the world's, (2, 2)."""
    c, s = ca.cos(pitch), ca.sin(pitch)
    return ca.blockcat([[c, s], [-s, c]])


def angle_noise(p: Any) -> ca.SX:
    """The deviation of an encoder's rounding, rad."""
    return p.encoder_resolution / sqrt(12)


def rate_noise(p: Any) -> ca.SX:
    """The deviation of the rate between two rounded angles, rad/s."""
    return sqrt(2) * angle_noise(p) / p.rate_window


def measurement_noise(p: Any) -> ca.SX:
    """Covariance of what is measured, (12, 12), in a tick without a shock."""
    std = ca.vertcat(*[angle_noise(p)] * JOINTS, *[rate_noise(p)] * JOINTS, *[p.foot_slide] * 2, *[p.foot_speed] * 2)
    noise = ca.diag(std**2)
    # a rate is taken between two rounded angles; the later one is the angle that is measured
    noise[ANGLES, RATES] = noise[RATES, ANGLES] = angle_noise(p) ** 2 / p.rate_window * EACH
    return noise


def process_noise(p: Any) -> ca.SX:
    """What a tick without a shock adds to the covariance, (28, 28)."""
    noise, dt = ca.SX(SIZE, SIZE), p.tick_seconds
    v = (p.accelerometer_noise * dt) ** 2
    noise[V, V], noise[P, P] = v * PLANE, v * dt**2 / 3 * PLANE
    noise[PITCH, PITCH], noise[GYRO_NOISE, GYRO_NOISE] = (p.gyro_noise * dt) ** 2, p.gyro_noise**2
    integrals = (J, 2), (DJ, 1), (DDJ, 0)  # of white noise: so often
    for a, i in integrals:
        for b, k in integrals:
            total = i + k + 1
            noise[a, b] = p.jerk**2 * dt**total / (total * factorial(i) * factorial(k)) * EACH
    noise[C, C] = p.foot_roll**2 * (dt / TICK_SECONDS) * PLANE  # a random walk
    return noise


def shock_noise(stance: ca.SX, p: Any) -> ca.SX:
    """What a shock of 1 m/s^2 adds, (28, 28): at an unknown moment of the tick it changes rates and accelerations."""
    noise, dt = ca.SX(SIZE, SIZE), p.tick_seconds
    noise[P, P], noise[V, V] = dt**4 / 12 * PLANE, (p.shock_speed * dt) ** 2 * PLANE
    more = ca.vertcat(*(ca.if_else(stance == joint // LEG_JOINTS, 1, p.swing_shock) for joint in range(JOINTS)))
    jump = ca.diag((more * p.shock_rate * dt) ** 2)
    noise[J, J], noise[DJ, DJ] = jump * dt**2 / 3, jump
    noise[J, DJ] = noise[DJ, J] = jump * dt / 2
    noise[DDJ, DDJ] = ca.diag((more * p.shock_acceleration) ** 2)
    return noise
