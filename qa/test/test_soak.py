"""The bars of a soak compare two different stretches of it, however short it is."""

import numpy as np
import pytest
from rabbit_campaigns.soak import windows


@pytest.mark.parametrize("seconds", [[0, 5], [0, 5, 200], [0, 5, 10], range(0, 7200, 5)])
def test_the_first_and_the_last_samples_are_not_the_same(seconds) -> None:
    """Also where an operation has taken long, so that one sample alone follows the warm-up."""
    first, last = windows(np.array(seconds, dtype=float))
    assert first.any()
    assert last.any()
    assert not (first & last).any()
