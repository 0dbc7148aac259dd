"""A message carries a state's numbers bit for bit."""

from dataclasses import asdict

import numpy as np
from rabbit_common.ros.conversions import header, state_message, state_of
from rabbit_description.state import RobotState, StonePreview


def test_a_state_comes_back_as_it_went() -> None:
    q, dq, foot_force, applied = (np.random.default_rng(0).normal(size=size) for size in (7, 7, (2, 2), 4))
    state = RobotState(12, q, dq, foot_force, np.array([True, False]), 3, StonePreview(4, 0.33, 0.38), applied=applied)
    back = state_of(state_message(state, episode=1, at=header(12)), state.preview)
    for name, value in asdict(state).items():
        np.testing.assert_array_equal(asdict(back)[name], value)
