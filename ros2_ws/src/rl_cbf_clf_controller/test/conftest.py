"""Random states of a walk."""

import numpy as np
import pytest
from rabbit_description.state import Array


@pytest.fixture(params=range(5))
def state(request: pytest.FixtureRequest) -> tuple[Array, Array]:
    """One of five random states `(q_s, dq_s)` as in a walk, knees flexed."""
    rng = np.random.default_rng(request.param)
    center = np.array([0.0, 0.75, 0.1, -0.3, 0.5, -0.3, 0.6])
    return center + rng.uniform(-0.3, 0.3, 7), rng.uniform(-3, 3, 7)
