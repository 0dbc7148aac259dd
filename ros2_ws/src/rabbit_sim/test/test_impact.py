"""The impact of the pinned model: an identity of its equations."""

import numpy as np
import pytest
from rabbit_description import URDF_PATH
from rabbit_description.state import Leg
from rabbit_sim.kinematics import RabbitFeet
from rabbit_sim.pinned_dynamics import PinnedDynamics


@pytest.mark.parametrize("leg", Leg)
def test_the_landed_foot_comes_to_rest(leg: Leg) -> None:
    q, dq = np.random.default_rng(0).normal(0, 0.3, (2, 7))
    after, impulse = PinnedDynamics(URDF_PATH.read_text(), RabbitFeet()).impact(q, dq, leg)
    assert RabbitFeet().jacobian(q, leg) @ after == pytest.approx([0, 0], abs=1e-12)
    assert np.abs(impulse).min() > 0
