"""Who goes first: SCHED_FIFO for a node that must be in time, a lower priority for nodes that can wait.

With SCHED_FIFO no ordinary process, however busy, keeps the node from its processor.

The middleware's processes share locks. One that is kept from its processor while it holds one keeps the others waiting,
whatever their priority; so all processes of a graph need one, those that only listen a lower one.
"""

import contextlib
import os
from collections.abc import Callable
from pathlib import Path

BENEATH = 10  # by so much the listeners are lower
NICE = 10  # by so much are nodes nicer that can wait


def take_priority(priority: int, warn: Callable[[str], object]) -> None:
    """Put all threads of this process, and those they will start, under SCHED_FIFO; 0 changes nothing.

    Where the machine does not permit it, `warn` gets a line that says what would, and the process stays ordinary.
    """
    try:
        if priority:
            _set_all_threads(os.SCHED_FIFO, priority)
    except PermissionError:
        warn(
            f"SCHED_FIFO priority {priority}: not permitted, goes on as an ordinary process; it needs CAP_SYS_NICE, "
            f"or `ulimit -r {priority}` (rtprio in /etc/security/limits.conf)"
        )


def take_listeners_priority(priority: int, warn: Callable[[str], object]) -> None:
    """The same as `take_priority`, just beneath the nodes of that priority."""
    take_priority(priority and max(1, priority - BENEATH), warn)


def give_way() -> None:
    """Let the calling thread, and those that it starts, go behind ordinary ones. It needs no permission.

    Call it once the middleware's threads run: those share locks with other processes.
    """
    os.nice(NICE)


def scheduling() -> str:
    """What the calling thread is under, as in `SCHED_FIFO 50`, or `ordinary`."""
    if os.sched_getscheduler(0) != os.SCHED_FIFO:
        return "ordinary"
    return f"SCHED_FIFO {os.sched_getparam(0).sched_priority}"


def step_back() -> None:
    """Put the calling thread just beneath the others of its process; nothing changes in an ordinary one.

    Not among the ordinary ones: while such a thread holds Python's interpreter lock and is kept from its processor, the
    others wait for it.
    """
    if os.sched_getscheduler(0) == os.SCHED_FIFO:
        beneath = max(1, os.sched_getparam(0).sched_priority - 1)
        os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(beneath))


def leave_priority(priority: int = 1) -> None:
    """Make all threads of this process ordinary again; 0 changes nothing."""
    if priority:
        _set_all_threads(os.SCHED_OTHER, 0)


def _set_all_threads(policy: int, priority: int) -> None:
    for thread in Path("/proc/self/task").iterdir():
        with contextlib.suppress(ProcessLookupError):  # it has ended
            os.sched_setscheduler(int(thread.name), policy, os.sched_param(priority))
