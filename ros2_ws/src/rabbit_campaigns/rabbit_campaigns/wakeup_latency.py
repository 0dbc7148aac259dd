"""A process that only sleeps from tick to tick: how often this machine itself is late, to hold a walk against."""

import contextlib
import multiprocessing
import os
import time
from collections.abc import Iterator
from typing import Any

from rabbit_description.state import TICK_SECONDS
from rabbit_sim.real_time import LATE_SECONDS


class Counts:
    """Ticks slept so far, and those that it was woken late for."""

    def __init__(self, shared: Any) -> None:
        self._shared = shared

    @property
    def late_share(self) -> float:
        """Share of late ticks; nan before the first."""
        ticks, late = self._shared
        return late / ticks if ticks else float("nan")


@contextlib.contextmanager
def sleeper(priority: int) -> Iterator[Counts]:
    """Beside what follows, under SCHED_FIFO `priority` where that is permitted; 0: an ordinary process."""
    context = multiprocessing.get_context("spawn")
    shared = context.RawArray("q", 2)
    process = context.Process(target=_sleep, args=(priority, shared), daemon=True)
    process.start()
    try:
        yield Counts(shared)
    finally:
        process.kill()
        process.join()


def _sleep(priority: int, counts: Any) -> None:
    if priority:
        with contextlib.suppress(PermissionError):
            os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(priority))
    due = time.monotonic()
    while True:
        due += TICK_SECONDS
        time.sleep(max(0.0, due - time.monotonic()))
        now = time.monotonic()
        counts[0] += 1
        if now - due > LATE_SECONDS:
            counts[1] += 1
            due = now  # as in a walk, the ticks after a late one move
