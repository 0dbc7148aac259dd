"""SCHED_FIFO for a node: with it no ordinary process, however busy, keeps the node from its processor."""

import os
from pathlib import Path


class NotPermitted(PermissionError):
    """The machine does not let this process take the priority; one line that says what would."""


def take_priority(priority: int) -> None:
    """Put all threads of this process, and those they will start, under SCHED_FIFO; 0 changes nothing.

    Raises:
        NotPermitted: neither CAP_SYS_NICE nor an rtprio limit as high as that.
    """
    if priority == 0:
        return
    try:
        for thread in Path("/proc/self/task").iterdir():
            os.sched_setscheduler(int(thread.name), os.SCHED_FIFO, os.sched_param(priority))
    except PermissionError as error:
        raise NotPermitted(
            f"SCHED_FIFO priority {priority}: not permitted, goes on as an ordinary process; it needs CAP_SYS_NICE, "
            f"or `ulimit -r {priority}` (rtprio in /etc/security/limits.conf)"
        ) from error


def scheduling() -> str:
    """What the calling thread is under, as in `SCHED_FIFO 50`, or `ordinary`."""
    if os.sched_getscheduler(0) != os.SCHED_FIFO:
        return "ordinary"
    return f"SCHED_FIFO {os.sched_getparam(0).sched_priority}"


def be_ordinary() -> None:
    """Take the calling thread out of it again: work that can wait."""
    os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
