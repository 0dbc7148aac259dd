"""What acts in a tick without a torque; when a machine is fit; what the simulator noted before it was killed."""

import os
import signal
from pathlib import Path

import numpy as np
import pytest
from pydantic import ValidationError
from rabbit_description.state import TICK_SECONDS
from rabbit_sim.parameters import SLOWEST, PlayerParameters
from rabbit_sim.real_time import LATE_SECONDS, WINDOW, Punctuality, Source, StandIn
from rabbit_sim.restart_file import RestartFile, RestartPoint

DAMPING = 10.0
TORQUE, RATES = np.array([1.0, 2.0, 3.0, 4.0]), np.array([1.0, -1.0, 0.5, 0.0])


@pytest.mark.parametrize("held", [0, 1, 2, 5])
@pytest.mark.parametrize("damped", [1, 10])
def test_a_dead_controller_is_held_for_then_damped_then_it_ends(held: int, damped: int) -> None:
    """One answer, and then none until the episode is over."""
    stand_in, answers = StandIn(held, damped, DAMPING), []
    stand_in.answer(0, TORQUE)
    while not stand_in.is_over:
        answers.append(stand_in.missed(1 + len(answers), RATES))
    assert [source for _, source in answers] == [Source.HELD] * held + [Source.DAMPING] * damped
    for torque, source in answers:
        assert np.array_equal(torque, TORQUE if source is Source.HELD else -DAMPING * RATES)
    assert stand_in.verdict("running")[0] == stand_in.verdict("fall")[0] == "silent"


def test_an_answer_that_is_late_by_a_tick_stands_in_for_the_next_one() -> None:
    """However long each one is late by that: the joints are never damped."""
    stand_in = StandIn(2, 1, DAMPING)
    for tick in range(1, 50):
        stand_in.answer(tick - 1, tick * TORQUE)
        torque, source = stand_in.missed(tick, RATES)
        assert source is Source.HELD
        assert np.array_equal(torque, tick * TORQUE)
        assert not stand_in.gave_up
    assert stand_in.verdict("walked") == ("walked", "")


@pytest.mark.parametrize("lag", [1, 2, 3, 4])
def test_no_torque_acts_that_answers_a_state_of_more_ticks_ago(lag: int) -> None:
    stand_in = StandIn(2, 1, DAMPING)
    stand_in.answer(10, TORQUE)
    assert stand_in.missed(10 + lag, RATES)[1] is (Source.HELD if lag <= 2 else Source.DAMPING)
    assert stand_in.gave_up == (lag > 2)  # then no answer counts
    stand_in.begin()
    assert not stand_in.gave_up


@pytest.mark.parametrize("pace", [5e-324, 1e-12, SLOWEST / 2])
def test_a_pace_whose_tick_no_timer_can_count_is_refused(pace: float) -> None:
    with pytest.raises(ValidationError, match="at least"):
        PlayerParameters(pace=pace)
    assert TICK_SECONDS / PlayerParameters(pace=SLOWEST).pace * 1e9 < 2**63  # a timer's ns


def test_fitness_is_the_share_of_late_ticks_in_the_newest_minute() -> None:
    limit = 0.001
    allowed = round(limit * WINDOW)
    watch = Punctuality(limit)
    for _ in range(allowed):
        watch.add(2 * LATE_SECONDS, Source.ANSWER)
    assert watch.is_fit
    watch.add(2 * LATE_SECONDS, Source.HELD)
    assert not watch.is_fit
    for _ in range(WINDOW):
        watch.add(LATE_SECONDS / 2, Source.ANSWER)
    assert watch.is_fit
    assert (watch.late, watch.missed, watch.worst) == (allowed + 1, 1, 2 * LATE_SECONDS)


def test_a_killed_process_has_noted_all_from_zero_on(tmp_path: Path) -> None:
    path = tmp_path / "new" / "memory"
    assert RestartFile(path).stand == RestartFile(None).stand == RestartPoint()
    child = os.fork()
    if child == 0:
        memory = RestartFile(path)
        for tick in range(1000):
            memory.note(**vars(RestartPoint(3, tick, 5000 + tick, True, 2, 2**64 - 1, 0.5, "ba639a4ab431")))
        os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(child, 0)
    assert RestartFile(path).stand == RestartPoint(3, 999, 5999, True, 2, 2**64 - 1, 0.5, "ba639a4ab431")
