"""How long a tick is: the paper's 10 ms, or fewer whole milliseconds, for a controller and its plant alike."""

from typing import Annotated

from pydantic import AfterValidator, Field

from rabbit_description.state import TICK_SECONDS

SUBSTEP_SECONDS = 0.001  # s, of every plant: a tick is a whole number of these


def whole_substeps(seconds: float) -> float:
    """The tick that is meant, s; raises `ValueError` where it is no whole number of substeps."""
    steps = seconds / SUBSTEP_SECONDS
    if abs(steps - round(steps)) > 1e-6:
        raise ValueError(f"a multiple of {SUBSTEP_SECONDS:g} s, as 0.01, 0.005, 0.002 or 0.001")
    return round(steps) / round(1 / SUBSTEP_SECONDS)


TickSeconds = Annotated[
    float, Field(ge=SUBSTEP_SECONDS, le=TICK_SECONDS, allow_inf_nan=False), AfterValidator(whole_substeps)
]
ABOUT_TICK = "length of a tick, of controller and plant alike, whole ms: 0.001 is 1000 Hz, s"


def ticks_in(seconds: float, tick_seconds: float) -> int:
    """The whole number of ticks that comes nearest to a time, at least one."""
    return max(round(seconds / tick_seconds), 1)
