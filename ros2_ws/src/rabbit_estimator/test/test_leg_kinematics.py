"""Kinematics of a leg against the URDF and finite differences."""

import numpy as np
import pytest
from rabbit_description.state import Leg
from rabbit_estimator.leg_kinematics import foothold, foothold_jacobian, foothold_rate_by_angles

STEP = 1e-6


@pytest.mark.parametrize("leg", Leg)
@pytest.mark.parametrize("radius", [0.0, 0.002])
def test_derivatives_are_those_of_the_foothold(leg, radius):
    rng = np.random.default_rng(leg)
    for _ in range(20):
        angles, rates = rng.normal(size=5), rng.normal(size=5)

        def at(x, leg=leg):
            return foothold(x[0], x[1:], leg, radius)

        jacobian = foothold_jacobian(angles[0], angles[1:], leg, radius)
        assert jacobian == pytest.approx(differences(at, angles), abs=1e-8)

        def rate(x, leg=leg, rates=rates):
            return foothold_jacobian(x[0], x[1:], leg, 0.0) @ rates

        by_angles = foothold_rate_by_angles(angles[0], angles[1:], leg, rates[0], rates[1:])
        assert by_angles == pytest.approx(differences(rate, angles), abs=1e-8)


def test_a_straight_leg_hangs_down():
    assert foothold(0.0, np.zeros(4), Leg.RIGHT, 0.002) == pytest.approx([0, -0.8])


def test_a_rolling_foot_stands_on_one_hold():
    """A wheel that rolls by an angle moves its centre by radius times the angle, and its hold not at all."""
    radius, turned = 0.05, 0.3
    before = foothold(0.0, np.zeros(4), Leg.LEFT, radius)
    after = foothold(turned, np.zeros(4), Leg.LEFT, radius)
    centre = foothold(turned, np.zeros(4), Leg.LEFT, 0.0)
    assert centre[0] - after[0] == pytest.approx(radius * turned)
    assert before[0] == 0


def differences(function, x):
    steps = STEP * np.eye(len(x))
    return np.column_stack([(function(x + step) - function(x - step)) / (2 * STEP) for step in steps])
