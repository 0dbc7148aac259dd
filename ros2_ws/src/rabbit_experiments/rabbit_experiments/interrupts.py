"""Signals while workers start."""

import signal
from collections.abc import Iterator
from contextlib import contextmanager
from multiprocessing import resource_tracker
from threading import current_thread, main_thread

from joblib.externals.loky.backend import resource_tracker as loky_tracker

ENDING = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def interrupts_held() -> Iterator[None]:
    """Workers that are started meanwhile never hear a Ctrl-C, which reaches the whole group: they inherit the mask.

    Here a signal is heard afterwards. Any thread may catch it, and an exception would cut short a worker's start.
    """
    for tracker in (resource_tracker, loky_tracker):
        tracker.ensure_running()  # whose start would let it in
    heard: list[int] = []
    is_main = current_thread() is main_thread()
    handlers = {number: signal.signal(number, lambda number, _: heard.append(number)) for number in ENDING if is_main}
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for number, handler in handlers.items():
            signal.signal(number, handler)
    if heard:
        signal.raise_signal(heard[0])
