"""Kinematics of a leg."""

import casadi as ca
import numpy as np
import pytest
from rabbit_description.state import Leg
from rabbit_estimator.leg_kinematics import foothold, foothold_rate

STEP = 1e-6


def at(pitch, joints, leg, radius):
    return ca.DM(foothold(pitch, joints, leg, radius)).full().ravel()


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


def test_a_straight_leg_hangs_down():
    assert at(0.0, np.zeros(4), Leg.RIGHT, 0.002) == pytest.approx([0, -0.8])


def test_a_rolling_foot_stands_on_one_hold():
    """A wheel that rolls by an angle moves its centre by radius times the angle, and its hold not at all."""
    radius, turned = 0.05, 0.3
    before = at(0.0, np.zeros(4), Leg.LEFT, radius)
    after = at(turned, np.zeros(4), Leg.LEFT, radius)
    centre = at(turned, np.zeros(4), Leg.LEFT, 0.0)
    assert centre[0] - after[0] == pytest.approx(radius * turned)
    assert before[0] == 0
