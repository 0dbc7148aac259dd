"""Which processors the nodes of a walk use: simulator and controller one to themselves, the others the rest.

In real time simulator and controller take turns, so one is enough for both, and nobody keeps them from it.
"""

import contextlib
import os
from collections.abc import Iterator
from typing import Annotated

from pydantic import AfterValidator, Field

SHARED = -1


def cores_of(core: int, is_walker: bool) -> frozenset[int]:
    """The processors of simulator and controller, or of the others; all, told as none, where they share.

    Raises:
        ValueError: this process may not use that processor, or no other one beside it.
    """
    if core == SHARED:
        return frozenset()
    own = os.sched_getaffinity(0)
    if core not in own or len(own) == 1:
        raise ValueError(f"{SHARED}, or one of {sorted(own)} where another one is left for the other nodes")
    return frozenset({core} if is_walker else own - {core})


def _usable(core: int) -> int:
    cores_of(core, is_walker=True)
    return core


Core = Annotated[
    int,
    Field(description="processor that simulator and controller have to themselves; -1: all nodes share all"),
    AfterValidator(_usable),
]


@contextlib.contextmanager
def keeping_to(cores: frozenset[int]) -> Iterator[None]:
    """Meanwhile this thread, and what it starts, uses these processors alone; none changes nothing."""
    before = os.sched_getaffinity(0)
    if cores:
        os.sched_setaffinity(0, cores)
    try:
        yield
    finally:
        os.sched_setaffinity(0, before)
