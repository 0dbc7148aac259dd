"""What a controller takes from a simulator: only ticks as long as its own."""

import math

import numpy as np
import pytest
from rabbit_msgs.msg import Episode, RobotState
from rl_cbf_clf_controller.ros.tick_intake import TickIntake

STATE = {"q": np.zeros(7), "dq": np.zeros(7), "applied": np.zeros(4), "contact": [True, False]}


@pytest.mark.parametrize("seconds", [0.01, 0.005])
def test_an_episode_of_another_tick_ends_and_both_are_named(seconds: float) -> None:
    intake = TickIntake()
    intake.announce(Episode(episode=1, phase=Episode.RUNNING, sigma=math.nan, tick_seconds=seconds))
    fault = intake.take(RobotState(episode=1, running=True, foot_force=np.zeros(4), **STATE))
    same = seconds == 0.01
    assert fault == ("" if same else "tick_seconds = 0.005 of the simulator; this controller has 0.01")
    assert (intake.held is not None) == same
