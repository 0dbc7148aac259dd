"""What acts in a tick without a torque, by the tick; and when a machine is fit for real time."""

import numpy as np
import pytest
from rabbit_sim.real_time import LATE_SECONDS, WINDOW, Punctuality, Source, StandIn

DAMPING = 10.0
TORQUE, RATES = np.array([1.0, 2.0, 3.0, 4.0]), np.array([1.0, -1.0, 0.5, 0.0])


def dead_controller(held_ticks: int, damped_ticks: int) -> tuple[list[Source], list[np.ndarray], StandIn]:
    """One answer, and then none until the episode is over."""
    stand_in = StandIn(held_ticks, damped_ticks, DAMPING)
    stand_in.answered(TORQUE)
    sources, torques = [], []
    while not stand_in.is_over:
        torque, source = stand_in.missed(RATES)
        sources.append(source)
        torques.append(torque)
    return sources, torques, stand_in


@pytest.mark.parametrize("held", [0, 1, 2, 5])
@pytest.mark.parametrize("damped", [1, 10])
def test_a_dead_controller_is_held_for_then_damped_then_it_ends(held: int, damped: int) -> None:
    sources, torques, stand_in = dead_controller(held, damped)
    assert sources == [Source.HELD] * held + [Source.DAMPING] * damped
    assert all(np.array_equal(torque, TORQUE) for torque in torques[:held])
    assert stand_in.verdict("running")[0] == stand_in.verdict("fall")[0] == "silent"


def test_damping_takes_power_out_of_every_joint() -> None:
    torque = dead_controller(0, 1)[1][0]
    assert np.array_equal(torque, -DAMPING * RATES)
    assert (torque * RATES[3:] <= 0).all()


def test_an_answer_in_between_begins_the_count_anew() -> None:
    stand_in = StandIn(2, 1, DAMPING)
    for _ in range(5):
        stand_in.answered(TORQUE)
        assert stand_in.missed(RATES)[1] is Source.HELD
        assert not stand_in.gave_up
    assert stand_in.verdict("walked") == ("walked", "")


def test_after_the_last_held_tick_no_answer_counts() -> None:
    stand_in = StandIn(2, 3, DAMPING)
    stand_in.answered(TORQUE)
    stand_in.missed(RATES)
    assert not stand_in.gave_up
    stand_in.missed(RATES)
    assert stand_in.gave_up
    stand_in.begin()
    assert not stand_in.gave_up


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
