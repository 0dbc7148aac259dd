"""|F_T| / F_N of a foot, which means something only where the foot is loaded."""

import numpy as np

from rabbit_description.state import Array

LOADED = 20.0  # N, normal force from which the ratio is judged and shown
IMPACT_TICKS = 4  # of a step's beginning, whose mean force may hold some of the 30 ms after impact


def force_ratio(force: Array) -> Array:
    """Of forces (..., 2): tangential, normal, N; NaN where the foot is not loaded."""
    tangential, normal = np.moveaxis(force, -1, 0)
    return np.divide(np.abs(tangential), normal, out=np.full(normal.shape, np.nan), where=normal > LOADED)
