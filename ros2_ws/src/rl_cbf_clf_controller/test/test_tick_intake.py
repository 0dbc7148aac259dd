"""What a controller takes from a simulator: ticks as long as its own, previews that are needed."""

import math
from random import Random

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from rabbit_common.message_checks import Refused
from rabbit_description.state import StonePreview
from rabbit_msgs.msg import Episode, RobotState
from rl_cbf_clf_controller.ros.tick_intake import NEWEST, PreviewBuffer, TickIntake

STATE = {"q": np.zeros(7), "dq": np.zeros(7), "applied": np.zeros(4), "contact": [True, False]}


def announced(episode: int, tick_seconds: float = 0.01) -> Episode:
    return Episode(episode=episode, phase=Episode.RUNNING, sigma=math.nan, tick_seconds=tick_seconds)


def state(episode: int, tick: int = 0) -> RobotState:
    return RobotState(episode=episode, tick=tick, running=True, foot_force=np.zeros(4), **STATE)


@pytest.mark.parametrize(
    ("seconds", "fault"), [(0.01, ""), (0.005, "tick_seconds = 0.005 of the simulator; this node has 0.01")]
)
def test_an_episode_of_another_tick_ends_and_both_are_named(seconds: float, fault: str) -> None:
    intake = TickIntake()
    intake.announce(announced(1, seconds))
    assert intake.take(state(1)) == fault
    assert (intake.held is None) == bool(fault)


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


PRESENT = 7


def stone(index: int) -> StonePreview:
    """One of a course."""
    return StonePreview(index=index, l_min=0.3, l_max=0.4)


def test_a_copy_of_another_stones_preview_is_not_taken_for_the_own_one() -> None:
    """A stranger repeats the preview of stone 1, stamped 10, as that of stone 2, and as the next episode's stone 1."""
    copy, own, next_own = StonePreview(2, 0.2, 0.25), StonePreview(2, 0.35, 0.4), StonePreview(1, 0.3, 0.35)
    previews = PreviewBuffer()
    previews.add(PRESENT, stone(1), 10, PRESENT)
    assert previews.get(PRESENT, 1, 0, 10) == stone(1)
    previews.add(PRESENT, copy, 10, PRESENT)
    previews.add(PRESENT + 1, StonePreview(1, 0.2, 0.25), 10, PRESENT)
    assert previews.get(PRESENT, 2, 49, 50) is None  # the own one is still on its way
    previews.add(PRESENT, own, 50, PRESENT)
    assert previews.get(PRESENT, 2, 49, 50) == own
    previews.add(PRESENT, copy, 51, PRESENT)
    assert previews.get(PRESENT, 2, 50, 51) == own  # as before
    previews.add(PRESENT + 1, next_own, 90, PRESENT)
    assert previews.get(PRESENT + 1, 1, 90, 90) == next_own


@settings(deadline=None)
@given(
    st.lists(st.tuples(st.integers(PRESENT + 2, 2**32 - 1), st.integers(1, 500)), max_size=60),
    st.integers(1, NEWEST),
    st.randoms(use_true_random=False),
)
def test_false_episodes_do_not_crowd_out_the_present_one(
    others: list[tuple[int, int]], count: int, rng: Random
) -> None:
    wanted = [(PRESENT, index) for index in range(1, count + 1)] + [(PRESENT + 1, 1)]
    told = [*others, *wanted]
    rng.shuffle(told)
    previews = PreviewBuffer()
    for episode, index in told:
        previews.add(episode, stone(index), 0, PRESENT)
    assert all(previews.get(*asked, 0, 0) == stone(asked[1]) for asked in wanted)
