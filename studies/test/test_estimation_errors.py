"""Shares of ticks within chi-square's bounds, of errors that are drawn from what is claimed."""

import numpy as np
import pytest
from rabbit_estimation.estimation_errors import shares


@pytest.mark.parametrize(("truth", "within", "above"), [(1.0, 0.95, 0.025), (1.5, 0.0, 1.0), (0.6, 0.0, 0.0)])
def test_the_mean_is_within_its_bounds_as_often_as_they_say(truth, within, above):
    """Errors as large as claimed, too large and too small; walks of different lengths, numbers that come and go."""
    rng = np.random.default_rng(1)
    walks = []
    for length in rng.integers(2000, 3000, 40):
        freedom = rng.choice([8, 12], length)
        walks.append(np.column_stack([truth * rng.chisquare(freedom) / freedom, freedom]))
    walks.append(walks[0][:5])  # a fall
    found = shares(walks)
    assert found[0] == pytest.approx(within, abs=0.02)
    assert found[1] == pytest.approx(above, abs=0.012)
