"""Speed regulation: at rest where the gait's speed is kept, clipped, slow to change; finds a slope, ignores a push."""

from functools import cache

import casadi as ca
import numpy as np
import pytest
from cbf_clf_qp.functions import NumpyFunction
from hypothesis import given, settings
from hypothesis import strategies as st
from rl_cbf_clf_controller.speed_regulation import (
    INTEGRAL_MOST,
    MOST,
    PER_SLOPE,
    RETAINED,
    level,
    regulated,
)

MISSING = st.floats(-3, 3)
EITHER = pytest.mark.parametrize(("kind", "most"), [("learned", MOST), ("integral", INTEGRAL_MOST)])


@cache
def functions(kind: str) -> tuple[NumpyFunction, NumpyFunction]:
    """What is kept at first, and after a touchdown."""
    least, most, missing, speed = map(ca.SX.sym, ("least", "most", "missing", "speed"))
    first = level(least, most)
    kept, between = {name: ca.SX.sym(name, *each.shape) for name, each in first.items()}, {"least": least, "most": most}
    inputs = {**kept, **between, "missing": missing, "v": speed}
    after = regulated(kept, least, most, missing, speed, kind)
    return NumpyFunction.of("level", between, first), NumpyFunction.of("regulated", inputs, after)


class Regulation:
    """Between the slopes `least` and `most`, degrees; `slope` is the present step's."""

    def __init__(self, kind: str, least: float, most: float) -> None:
        self._level, self._regulated = functions(kind)
        self._between = np.array([[least], [most]])
        self.reset()

    def reset(self) -> None:
        self._kept = self._level(*self._between)

    @property
    def slope(self) -> float:
        return float(self._kept.slopes[0])

    def after(self, rate_missing: float, speed_missing: float) -> float:
        kept = (getattr(self._kept, name) for name in ("slopes", "speed", "found", "integral"))
        self._kept = self._regulated(*kept, *self._between, np.array([rate_missing]), np.array([-speed_missing]))
        return self.slope


@EITHER
def test_it_rests_at_the_gait_s_speed(kind: str, most: float) -> None:
    regulation = Regulation(kind, -6.0, 6.0)
    assert [regulation.after(0.0, 0.0) for _ in range(5)] == [0.0] * 5
    tilted = Regulation(kind, 2.0, 6.0)
    assert tilted.after(0.0, 0.0) == 2.0, "the slope nearest to level ground"


@EITHER
@settings(deadline=None)
@given(missing=st.lists(st.tuples(MISSING, MISSING), min_size=1, max_size=30))
def test_the_slope_stays_within_the_library_and_changes_slowly(
    kind: str, most: float, missing: list[tuple[float, float]]
) -> None:
    regulation, before = Regulation(kind, -6.0, 4.0), 0.0
    for rate, speed in missing:
        slope = regulation.after(rate, speed)
        assert -6.0 <= slope <= 4.0
        assert abs(slope - before) <= most + 1e-12
        before = slope


@pytest.mark.parametrize("true_slope", [-4.0, -1.0, 0.0, 2.0])
@pytest.mark.parametrize("gain", [0.7, 1.0, 1.5])
def test_the_rule_without_a_model_settles_at_the_true_slope_too(true_slope: float, gain: float) -> None:
    """The rate's Poincaré map, linear: it falls back to the gait's by the eigenvalue 0.72, and a step for a slope that
    is one degree too steep adds 0.07 rad/s (of `slopes`' zero dynamics; also 0.7 and 1.5 times as much)."""
    regulation, missing = Regulation("integral", -6.0, 6.0), 0.0
    for _ in range(60):
        slope = regulation.after(missing, 0.5 * missing)  # step length times rate over phase: m/s for rad/s
        missing = 0.72 * missing - 0.07 * gain * (slope - true_slope)
    assert slope == pytest.approx(true_slope, abs=0.02)
    assert missing == pytest.approx(0.0, abs=0.01)


class LinearWalk:
    """Speeds that follow the regulation's own model on ground of a slope, with coefficients `gain` times as large."""

    def __init__(self, true_slope: float, gain: float = 1.0) -> None:
        self.regulation, self.true_slope, self.gain = Regulation("learned", -6.0, 6.0), true_slope, gain
        self.speed, self.slopes = 0.0, [0.0] * len(PER_SLOPE)

    def step(self, push: float = 0.0, per_speed: float = 0.0) -> float:
        """The slope of the next step, after one in which a push adds to the speed; the rate's part is `per_speed`."""
        self.slopes = [self.regulation.slope, *self.slopes][: len(PER_SLOPE)]
        effect = np.dot(PER_SLOPE, np.array(self.slopes) - self.true_slope)
        self.speed = RETAINED * self.speed + self.gain * effect + push
        return self.regulation.after(-per_speed * self.speed, -self.speed)


@pytest.mark.parametrize("true_slope", [-4.0, -1.0, 0.0, 2.0])
@pytest.mark.parametrize("gain", [0.7, 1.0, 1.5])
def test_on_a_linear_walk_it_settles_at_the_true_slope(true_slope: float, gain: float) -> None:
    walk = LinearWalk(true_slope, gain)
    slopes = [walk.step(per_speed=2.0) for _ in range(80)]
    assert slopes[-1] == pytest.approx(true_slope, abs=0.05)
    assert walk.speed == pytest.approx(0.0, abs=0.01)


@pytest.mark.parametrize("true_slope", [-3.0, 0.0, 2.0])
@pytest.mark.parametrize("push", [-0.3, 0.3])
def test_a_push_is_not_taken_for_a_slope(true_slope: float, push: float) -> None:
    """One every third step, forward and backward in turn: the median of six leaves two of them out."""
    walk = LinearWalk(true_slope)
    for _ in range(20):
        walk.step()
    assert walk.regulation.slope == pytest.approx(true_slope, abs=1e-3)
    for step in range(30):
        slope = walk.step(push * (-1) ** (step // 3) if step % 3 == 0 else 0.0)
        assert slope == pytest.approx(true_slope, abs=1e-3)
