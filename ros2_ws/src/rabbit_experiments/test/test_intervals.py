"""Wilson's interval: successes and failures change places with its ends."""

import pytest
from rabbit_experiments.summary import wilson


@pytest.mark.parametrize(("successes", "runs"), [(0, 10), (3, 10), (10, 10)])
def test_wilsons_interval_is_symmetric(successes: int, runs: int) -> None:
    low, high = wilson(successes, runs)
    assert 0 <= low <= successes / runs <= high <= 1
    assert wilson(runs - successes, runs) == pytest.approx((1 - high, 1 - low))
