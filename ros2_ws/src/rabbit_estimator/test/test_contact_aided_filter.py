"""The filter on motions that are known exactly."""

from dataclasses import replace

import numpy as np
import pytest
from pydantic import BaseModel
from rabbit_description.state import TICK_SECONDS, BodySensors, Leg, RobotState, orientation_of
from rabbit_estimator.contact_aided_filter import ContactAidedFilter, EstimatorError
from rabbit_estimator.leg_kinematics import foothold
from rabbit_estimator.parameters import EstimatorParameters

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


def test_a_robot_that_stands_still_is_known_at_once_and_stays():
    estimator = ContactAidedFilter(EstimatorParameters())
    for tick in range(200):
        estimate = estimator.update(state(tick))
    hip = -foothold(PITCH, JOINTS, Leg.LEFT, 0.002)
    assert estimate.q == pytest.approx([*hip, PITCH, *JOINTS], abs=1e-6)
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
    fallen = estimate.q[:2] + foothold(PITCH, JOINTS, Leg.LEFT, 0.002)
    assert fallen == pytest.approx([0, -G * time**2 / 2], abs=1e-9)


def test_a_foot_on_the_ground_says_more_than_none():
    """Hip velocity is surer with a foot that stands; the covariance stays one."""
    spreads = []
    for contact in (LEFT, NEITHER):
        estimator = ContactAidedFilter(EstimatorParameters())
        for tick in range(50):
            estimator.update(state(tick, contact if tick else LEFT))
            assert estimator.covariance == pytest.approx(estimator.covariance.T, abs=1e-15)
            assert np.linalg.eigvalsh(estimator.covariance).min() > -1e-9  # rounding
        spreads.append(np.sqrt(estimator.angles_and_rates_covariance()[5, 5]))
    assert spreads[0] < spreads[1]


def test_a_reset_forgets_the_last_episode():
    fresh, used = (ContactAidedFilter(EstimatorParameters()) for _ in range(2))
    for tick in range(20):
        used.update(state(tick, joint_angles=JOINTS + 0.1 * tick))
    for tick in range(3):
        first, second = (each.update(state(tick)) for each in (fresh, used))
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
    for each in (estimator, fresh):
        each.update(state(0))
    with pytest.raises(EstimatorError, match=name):
        estimator.update(wrong)
    assert (estimator.update(state(1)).q == fresh.update(state(1)).q).all()


def test_it_knows_the_errors_of_the_sensors_but_trusts_none_to_be_perfect():
    class Simulated(BaseModel):
        gyro_bias: float = 0.3
        encoder_offset: float = 0.0
        mass_scale: float = 2.0

    assert EstimatorParameters.knowing(Simulated()) == EstimatorParameters(gyro_bias=0.3)
