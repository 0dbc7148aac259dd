"""What a controller takes from a simulator: only ticks as long as its own."""

import math

import numpy as np
import pytest
from rabbit_common.message_checks import Refused
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


def announced(episode: int) -> Episode:
    return Episode(episode=episode, phase=Episode.RUNNING, sigma=math.nan, tick_seconds=0.01)


def state(episode: int, tick: int = 0) -> RobotState:
    return RobotState(episode=episode, tick=tick, running=True, foot_force=np.zeros(4), **STATE)


def test_a_controller_that_was_led_ahead_comes_back() -> None:
    """By an episode that never was; its simulator goes on with the next one, and says so each time that it asks."""
    intake = TickIntake()
    for episode in (3, 2**32 - 1):
        intake.announce(announced(episode))
        assert intake.take(state(episode)) == ""
    with pytest.raises(Refused, match="late"):
        intake.announce(announced(4))
    intake.announce(announced(4))
    assert intake.take(state(4)) == ""
    assert intake.turn == (4, 0)


def test_one_late_announcement_at_a_time_changes_nothing() -> None:
    intake = TickIntake()
    intake.announce(announced(3))
    for tick in range(4):
        assert intake.take(state(3, tick)) == ""
        with pytest.raises(Refused, match="late"):
            intake.announce(announced(2))
    assert intake.turn == (3, 3)
