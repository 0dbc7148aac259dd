"""Speed regulation: at rest where the gait's speed is kept, clipped, slow to change, and stable on a linear walk."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rl_cbf_clf_controller.speed_regulation import MOST, SpeedRegulation

MISSING = st.floats(-3, 3)


def test_it_rests_at_the_gait_s_speed() -> None:
    regulation = SpeedRegulation(-6.0, 6.0)
    assert [regulation.after(0.0, 0.0) for _ in range(5)] == [0.0] * 5
    tilted = SpeedRegulation(2.0, 6.0)
    assert tilted.after(0.0, 0.0) == 2.0, "the slope nearest to level ground"


@given(missing=st.lists(st.tuples(MISSING, MISSING), min_size=1, max_size=30))
def test_the_slope_stays_within_the_library_and_changes_slowly(missing: list[tuple[float, float]]) -> None:
    regulation, before = SpeedRegulation(-6.0, 4.0), 0.0
    for rate, speed in missing:
        slope = regulation.after(rate, speed)
        assert -6.0 <= slope <= 4.0
        assert abs(slope - before) <= MOST + 1e-12
        before = slope


@given(missing=st.lists(st.tuples(MISSING, MISSING), max_size=30), after=st.tuples(MISSING, MISSING))
def test_a_reset_forgets(missing: list[tuple[float, float]], after: tuple[float, float]) -> None:
    used, fresh = SpeedRegulation(-6.0, 6.0), SpeedRegulation(-6.0, 6.0)
    for rate, speed in missing:
        used.after(rate, speed)
    used.reset()
    assert used.slope == fresh.slope
    assert used.after(*after) == fresh.after(*after)


def test_a_slow_robot_gets_a_steeper_step_and_a_fast_one_a_flatter() -> None:
    for rate, speed in ((0.2, 0.0), (0.0, 0.1)):
        assert SpeedRegulation(-6.0, 6.0).after(rate, speed) > 0
        assert SpeedRegulation(-6.0, 6.0).after(-rate, -speed) < 0


@pytest.mark.parametrize("true_slope", [-4.0, -1.0, 0.0, 2.0])
@pytest.mark.parametrize("gain", [0.7, 1.0, 1.5])
def test_on_a_linear_walk_it_settles_at_the_true_slope(true_slope: float, gain: float) -> None:
    """The rate's Poincaré map, linear: it falls back to the gait's by the eigenvalue 0.72, and a step for a slope that
    is one degree too steep adds 0.07 rad/s (of `slopes`' zero dynamics; also 0.7 and 1.5 times as much)."""
    regulation, missing = SpeedRegulation(-6.0, 6.0), 0.0
    for _ in range(60):
        slope = regulation.after(missing, 0.5 * missing)  # step length times rate over phase: m/s for rad/s
        missing = 0.72 * missing - 0.07 * gain * (slope - true_slope)
    assert slope == pytest.approx(true_slope, abs=0.02)
    assert missing == pytest.approx(0.0, abs=0.01)
    assert np.isfinite(missing)
