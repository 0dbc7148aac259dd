"""Random states of a walk."""

import numpy as np
import pytest
from rabbit_description.state import Array


def random_states(count: int, seed: int = 0) -> list[tuple[Array, Array]]:
    """Walking-like random states `(q_s, dq_s)`, knees flexed."""
    rng = np.random.default_rng(seed)
    center = np.array([0.0, 0.75, 0.1, -0.3, 0.5, -0.3, 0.6])
    return [(center + rng.uniform(-0.3, 0.3, 7), rng.uniform(-3, 3, 7)) for _ in range(count)]


@pytest.fixture(params=range(5))
def state(request: pytest.FixtureRequest) -> tuple[Array, Array]:
    """One of five seeded random states."""
    return random_states(5)[request.param]
