"""|F_T| / F_N of a foot, which means something only where the foot is loaded."""

import math

import numpy as np

from rabbit_description.state import TICK_SECONDS, Array

LOADED = 20.0  # N, normal force from which the ratio is judged and shown
IMPACT_SECONDS = 0.03  # s after impact, in which a foot's force says little


def impact_ticks(tick_seconds: float = TICK_SECONDS) -> int:
    """So many of a step's beginning, whose mean force may hold some of the time after impact."""
    return math.ceil(IMPACT_SECONDS / tick_seconds - 1e-9) + 1


def force_ratio(force: Array) -> Array:
    """The ratio of forces (..., 2), tangential and normal, N; NaN where the foot is not loaded."""
    tangential, normal = np.moveaxis(force, -1, 0)
    return np.divide(np.abs(tangential), normal, out=np.full(normal.shape, np.nan), where=normal > LOADED)
