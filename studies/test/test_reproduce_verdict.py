"""Verdicts, and which payload is the largest."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rabbit_experiments.metrics import RunRow
from rabbit_experiments.summary import Walks
from rabbit_reproduce.report import Verdict, judge, missing

COUNTS = {name: 0 for name, field in RunRow.model_fields.items() if field.annotation in (int, float)}


def walks(*stones: int, of: int = 20) -> Walks:
    """Runs that came so far."""
    rows = [
        RunRow.model_validate(
            COUNTS | {"outcome": "", "stones": n, "success": n == of, "success_with_forces": n == of, "ticks": 1}
        )
        for n in stones
    ]
    return Walks(rows)


@given(st.dictionaries(st.text(min_size=1), st.booleans(), min_size=1), st.booleans())
def test_verdict_by_parts(parts: dict[str, bool], nominal: bool) -> None:
    verdict = judge(parts, nominal)
    if all(parts.values()):
        assert verdict is (Verdict.NOTHING if nominal else Verdict.REPRODUCED)
        assert missing(parts) == ""
    else:
        assert verdict is (Verdict.PARTLY if any(parts.values()) else Verdict.NOT)
        assert missing(parts).startswith("not: ")


@pytest.mark.parametrize(("walked", "passes"), [(10, True), (9, True), (8, False), (0, False)])
def test_nine_of_ten_walk(walked: int, passes: bool) -> None:
    runs = walks(*[20] * walked, *[3] * (10 - walked))
    assert runs.passes is passes
    assert (runs.walked, runs.runs) == (walked, 10)
    low, high = runs.interval
    assert 0 <= low <= walked / 10 <= high <= 1
    assert runs.mean_stones == pytest.approx((20 * walked + 3 * (10 - walked)) / 10)


def test_deviation_and_interval_of_two() -> None:
    """Of 2 and 4: deviation sqrt(2), standard error 1, Student's t of one degree of freedom 12.706."""
    runs = walks(2, 4)
    assert runs.std_stones == pytest.approx(2**0.5)
    assert runs.stones_interval == pytest.approx((0, 3 + 12.7062), abs=1e-3)  # and not 3 - 12.7062
    assert Walks(runs.rows, course=20).stones_interval == pytest.approx((0, 3 + 12.7062), abs=1e-3)
    assert Walks(runs.rows, course=4).stones_interval == (0, 4)
    assert (walks(2).std_stones, walks(2).stones_interval) == (None, None)
