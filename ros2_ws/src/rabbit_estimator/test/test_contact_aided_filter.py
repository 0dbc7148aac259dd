"""The filter on motions that are known exactly; kinematics of a leg."""

import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from rabbit_description.state import TICK_SECONDS, BodySensors, Leg, RobotState, orientation_of
from rabbit_estimator.contact_aided_filter import (
    COMPLIANCE,
    MEASURED,
    OFFSET,
    ContactAidedFilter,
    EstimatorError,
    LostError,
)
from rabbit_estimator.encoder_gate import PATIENCE
from rabbit_estimator.leg_kinematics import foothold, foothold_rate
from rabbit_estimator.parameters import EstimatorParameters
from scipy.stats import chi2

G = 9.81
PITCH, JOINTS = 0.1, np.array([-0.3, 0.4, 0.2, 0.7])
LEFT, NEITHER = np.array([True, False]), np.zeros(2, bool)


def state(tick, contact=LEFT, specific_force=None, **changes):
    """Nothing moves: an accelerometer feels the ground's push alone."""
    push = np.array([-G * np.sin(PITCH), G * np.cos(PITCH)])
    force = np.full(2, np.nan) if tick == 0 else push if specific_force is None else specific_force
    sensors = BodySensors(JOINTS, np.zeros(4), orientation_of(PITCH), 0.0, force)
    unknown = np.full(7, np.nan)
    return RobotState(tick, unknown, unknown, np.zeros((2, 2)), contact, 0, None, sensors=replace(sensors, **changes))


def at(pitch, joints, leg=Leg.LEFT, radius=0.002):
    """The foothold from the hip."""
    return ca.DM(foothold(pitch, joints, leg, radius)).full().ravel()


def test_robots_that_stand_still_are_known_and_filters_of_several_threads_know_nothing_of_each_other():
    """Each robot stands at a pitch of its own, and is found there."""

    def found(pitch):
        estimator, rest = ContactAidedFilter(EstimatorParameters()), np.array([-G * np.sin(pitch), G * np.cos(pitch)])
        for tick in range(1000):
            force = np.full(2, np.nan) if tick == 0 else rest
            estimate = estimator.update(state(tick, specific_force=force, orientation=orientation_of(pitch)))
        return estimate

    pitches, usual = [-0.2, 0.0, PITCH, 0.3], sys.getswitchinterval()
    sys.setswitchinterval(1e-6)
    try:
        with ThreadPoolExecutor(len(pitches)) as pool:
            estimates = [*pool.map(found, pitches)]
    finally:
        sys.setswitchinterval(usual)
    for estimate, pitch in zip(estimates, pitches, strict=True):
        assert estimate.q == pytest.approx([*-at(pitch, JOINTS), pitch, *JOINTS], abs=1e-6)
        assert estimate.dq == pytest.approx(np.zeros(7), abs=1e-6)


def test_a_robot_in_free_fall_falls():
    """Without a foot on the ground there is the IMU alone, and it feels nothing."""
    estimator = ContactAidedFilter(EstimatorParameters())
    estimator.update(state(0))
    ticks = 10
    for tick in range(1, ticks + 1):
        estimate = estimator.update(state(tick, NEITHER, np.zeros(2)))
    time = ticks * TICK_SECONDS
    assert estimate.dq[:2] == pytest.approx([0, -G * time], abs=1e-9)
    fallen = estimate.q[:2] + at(PITCH, JOINTS)
    assert fallen == pytest.approx([0, -G * time**2 / 2], abs=1e-9)


def test_late_readings_are_taken_for_what_they_are():
    """Joints that turn steadily are where they are now, not where they were when the encoders were read."""
    late, rates = 0.008, np.array([0.5, -0.4, 0.3, 0.2])
    estimator = ContactAidedFilter(EstimatorParameters(sensor_delay=late))
    for tick in range(100):
        read = JOINTS + rates * (tick * TICK_SECONDS - late)
        estimate = estimator.update(state(tick, NEITHER if tick else LEFT, joint_angles=read, joint_rates=rates))
    assert estimate.q[3:] == pytest.approx(JOINTS + rates * tick * TICK_SECONDS, abs=1e-5)
    assert estimate.dq[3:] == pytest.approx(rates, abs=1e-3)


@pytest.mark.parametrize("compliance", [1e-6, 1e-5])
def test_it_finds_how_far_the_ground_gives(compliance):
    """A robot with stiff joints rides on its foot: a spring and a damper, under a load that comes and goes."""
    parameters = EstimatorParameters()
    estimator = ContactAidedFilter(parameters)
    estimator.update(state(0))
    parts, sunk, speed = 100, 0.0, 0.0
    for tick in range(1, 201):
        last = speed
        loads = 300 + 200 * np.sin(0.3 * (tick - 1 + np.arange(parts) / parts))
        for load in loads:
            speed = -(compliance * load - sunk) / parameters.sinking_time
            sunk -= speed * TICK_SECONDS / parts
        up = G + (speed - last) / TICK_SECONDS
        push = up * np.array([-np.sin(PITCH), np.cos(PITCH)])
        force = np.array([[0, loads.mean()], [0, 0]])
        estimate = estimator.update(replace(state(tick, specific_force=push), foot_force=force))
    belief = estimator.belief
    mean, error = belief.mean[COMPLIANCE], np.sqrt(belief.covariance[COMPLIANCE, COMPLIANCE])
    assert error < 0.1 * parameters.compliance_error
    assert mean == pytest.approx(compliance, rel=0.05, abs=3 * error)
    assert estimate.dq[1] == pytest.approx(speed, abs=3e-3)


def test_in_free_flight_the_normalised_error_is_that_of_a_consistent_filter():
    """The truth is drawn from the filter's own model: the mean NEES over n walks is chi-square(12 n) / n.

    The takeoff, tick 1, is a shock to the filter and none in truth.
    """
    walks, ticks = 60, 15
    nees = np.array([flight(np.random.default_rng(seed), ticks) for seed in range(walks)])
    low, high = (chi2.ppf(share, 12 * walks) / walks for share in (0.0005, 0.9995))
    means = np.delete(nees.mean(axis=0), 1)
    assert (means > low).all()
    assert (means < high).all()


def flight(rng, ticks):
    """NEES of each tick: the left foot stood at tick 0, then the robot falls as its joints wander."""
    p = EstimatorParameters()
    estimator = ContactAidedFilter(p)
    offset = p.encoder_offset * rng.standard_normal(4) + p.bend * rng.standard_normal() * np.array([1, 0, 1, 0])
    bias, attitude_error = p.gyro_bias * rng.standard_normal(), p.attitude_error * rng.standard_normal()
    accelerometer_bias = p.accelerometer_bias * rng.standard_normal(2)
    joints, rates = JOINTS.copy(), rng.standard_normal(4)
    accelerations = p.first_acceleration * rng.standard_normal(4)
    speed = -ca.evalf(foothold_rate(PITCH, joints, Leg.LEFT, p.foot_radius, 0.0, rates)).full().ravel()
    speed += p.first_speed * rng.standard_normal(2)
    squares = []
    parts = 50
    for tick in range(ticks):
        if tick:
            for _ in range(parts):
                step = TICK_SECONDS / parts
                joints = joints + rates * step + accelerations * step**2 / 2
                rates = rates + accelerations * step
                accelerations = accelerations + p.jerk * np.sqrt(step) * rng.standard_normal(4)
            speed = speed + np.array([0, -G]) * TICK_SECONDS
            attitude_error += TICK_SECONDS * (bias + p.gyro_noise * rng.standard_normal())
        before = joints - p.rate_window * rates + p.rate_window**2 / 2 * accelerations * (tick > 0)
        step = p.encoder_resolution
        angle, earlier = (step * np.round((at + offset) / step) for at in (joints, before))
        sensors = BodySensors(
            angle,
            (angle - earlier) / p.rate_window,
            orientation_of(PITCH + attitude_error),
            bias + p.gyro_noise * rng.standard_normal(),
            accelerometer_bias + p.accelerometer_noise * rng.standard_normal(2) if tick else np.full(2, np.nan),
        )
        estimate = estimator.update(replace(state(tick, NEITHER if tick else LEFT), sensors=sensors))
        truth = np.concatenate([[PITCH], joints, speed, [0], rates])
        error = np.concatenate([estimate.q[2:], estimate.dq]) - truth
        squares.append(error @ np.linalg.solve(estimator.angles_and_rates_covariance(), error))
    return squares


def turned(tick, joint, angle):
    """The state of a tick in which an encoder says another angle."""
    return state(tick, joint_angles=JOINTS + angle * (np.arange(4) == joint))


@pytest.mark.parametrize("joint", range(4))
@pytest.mark.parametrize("glitch", [0.05, -0.3, 3.0])
def test_a_glitch_of_an_encoder_is_refused(joint, glitch):
    """The estimate goes on within the encoders' resolution, and the next reading is used."""
    estimator = ContactAidedFilter(EstimatorParameters())
    for tick in range(50):
        before = estimator.update(state(tick))
    during, after = estimator.update(turned(50, joint, glitch)), estimator.update(state(51))
    for estimate in (during, after):
        assert estimate.q == pytest.approx(before.q, abs=4e-4)
        assert estimate.dq == pytest.approx(before.dq, abs=0.05)
    assert estimator.belief.measured == MEASURED  # all are used again


@pytest.mark.parametrize("joint", range(4))
def test_an_encoder_that_says_the_same_for_long_is_not_refused_for_ever(joint):
    estimator = ContactAidedFilter(EstimatorParameters())
    for tick in range(50):
        estimator.update(state(tick))
    refused = 0
    for tick in range(50, 70):
        estimator.update(turned(tick, joint, 0.3))
        refused += estimator.belief.measured[0] < MEASURED
    assert 1 <= refused <= PATIENCE / TICK_SECONDS
    read = estimator.belief.q[3 + joint] + estimator.belief.mean[OFFSET][joint]  # the angle, and the encoder's zero
    assert read == pytest.approx(JOINTS[joint] + 0.3, abs=1e-3)


def test_a_reset_forgets_the_last_episode():
    fresh, used = (ContactAidedFilter(EstimatorParameters()) for _ in range(2))
    for tick in range(20):
        used.update(state(tick, joint_angles=JOINTS + 0.1 * tick))
    for tick in range(3):
        first, second = (filter_.update(state(tick)) for filter_ in (fresh, used))
        assert (first.q == second.q).all()
        assert (first.dq == second.dq).all()


@pytest.mark.parametrize(
    ("wrong", "name"),
    [
        (replace(state(1), sensors=None), "state.sensors = None"),
        (state(2), "state.tick = 2: expected 1"),
        (state(1, orientation=np.full(2, np.nan)), "sensors.attitude = nan"),
        (state(1, joint_angles=np.full(4, np.inf)), "sensors.joint_angles"),
    ],
)
def test_what_cannot_be_used_is_named_and_changes_nothing(wrong, name):
    estimator, fresh = (ContactAidedFilter(EstimatorParameters()) for _ in range(2))
    for filter_ in (estimator, fresh):
        filter_.update(state(0))
    with pytest.raises(EstimatorError, match=name):
        estimator.update(wrong)
    assert (estimator.update(state(1)).q == fresh.update(state(1)).q).all()


def test_what_is_finite_and_too_large_gives_no_state_in_part():
    """q and dq are finite, or their loss is said."""
    rng, lost = np.random.default_rng(0), 0
    for _ in range(100):
        estimator = ContactAidedFilter(EstimatorParameters())
        estimator.update(state(0))
        large = rng.normal(size=4) * 10.0 ** rng.uniform(-3, 300, 4)
        rate = float(rng.normal() * 10.0 ** rng.uniform(-3, 300))
        try:
            estimate = estimator.update(state(1, joint_rates=large, pitch_rate=rate, specific_force=large[:2]))
        except LostError:
            lost += 1
        else:
            assert np.isfinite([*estimate.q, *estimate.dq]).all()
    assert lost > 50


STEP = 1e-6


@pytest.mark.parametrize("leg", Leg)
@pytest.mark.parametrize("radius", [0.0, 0.002])
def test_the_rate_is_that_of_the_foothold(leg, radius):
    rng = np.random.default_rng(leg)
    for _ in range(20):
        (pitch, *joints), (pitch_rate, *rates) = rng.normal(size=(2, 5))
        joints, rates = np.array(joints), np.array(rates)
        ends = [at(pitch + step * pitch_rate, joints + step * rates, leg, radius) for step in (-STEP, STEP)]
        rate = ca.evalf(foothold_rate(pitch, joints, leg, radius, pitch_rate, rates)).full().ravel()
        assert rate == pytest.approx((ends[1] - ends[0]) / (2 * STEP), abs=1e-8)


def test_a_straight_leg_hangs_down_and_a_rolling_foot_stands_on_one_hold():
    """A wheel that rolls by an angle moves its centre by radius times the angle, and its hold not at all."""
    assert at(0.0, np.zeros(4), Leg.RIGHT) == pytest.approx([0, -0.8])
    radius, turned = 0.05, 0.3
    before, after, centre = (at(a, np.zeros(4), radius=r) for a, r in ((0.0, radius), (turned, radius), (turned, 0.0)))
    assert centre[0] - after[0] == pytest.approx(radius * turned)
    assert before[0] == 0
