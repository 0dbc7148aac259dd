"""A process that only sleeps from tick to tick: how often this machine itself is late, to hold a walk against."""

import contextlib
import multiprocessing
import os
import time
from collections.abc import Callable, Iterator
from typing import Any

from rabbit_description.state import TICK_SECONDS
from rabbit_sim.real_time import LATE_SECONDS


@contextlib.contextmanager
def sleeper(priority: int) -> Iterator[Callable[[], float]]:
    """Beside what follows, under SCHED_FIFO `priority` where that is permitted; 0: an ordinary process.

    Gives a function that returns the share of its ticks so far that it was woken late for; nan before the first.
    """
    context = multiprocessing.get_context("spawn")
    counts = context.RawArray("q", 2)  # ticks, late ones
    process = context.Process(target=_sleep, args=(priority, counts), daemon=True)
    process.start()
    try:
        yield lambda: counts[1] / counts[0] if counts[0] else float("nan")
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
