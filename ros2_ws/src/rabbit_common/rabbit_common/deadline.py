"""Ends the process at a deadline, even while a C library holds Python's interpreter lock and waits for ever.

Fast DDS 2.14 can wait so: if other participants leave at the same moment, its thread that hears of it and the thread
that deletes the participant each wait for the other.
"""

import ctypes
import os
import sys

_MONOTONIC, _IN_A_THREAD = 1, 2  # CLOCK_MONOTONIC, SIGEV_THREAD


class _Event(ctypes.Structure):
    """`sigevent` of Linux, 64 bit."""

    _fields_ = (
        ("value", ctypes.c_uint64),
        ("signal", ctypes.c_int),
        ("notify", ctypes.c_int),
        ("function", ctypes.c_void_p),
        ("rest", ctypes.c_uint64 * 5),
    )


class _Times(ctypes.Structure):
    """`itimerspec`, s and ns."""

    _fields_ = tuple((name, ctypes.c_long) for name in ("interval", "interval_ns", "seconds", "nanoseconds"))


def end_within(seconds: int, code: int) -> None:
    """From now on the process has so many seconds, s, before it ends with this exit code; `OSError` if it cannot."""
    sys.stdout.flush()
    sys.stderr.flush()
    libc = ctypes.CDLL(None, use_errno=True)
    event = _Event(code, 0, _IN_A_THREAD, ctypes.cast(libc._exit, ctypes.c_void_p))
    timer, times = ctypes.c_void_p(), _Times(0, 0, seconds, 0)
    failed = libc.timer_create(_MONOTONIC, ctypes.byref(event), ctypes.byref(timer))
    if failed or libc.timer_settime(timer, 0, ctypes.byref(times), None):
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))
