"""Child processes that do not outlive the process that started them, whatever ends it."""

import ctypes
import os
import signal

_PR_SET_PDEATHSIG = 1
_libc = ctypes.CDLL(None)


def end_with_parent(parent: int | None = None) -> None:
    """Ends a child as SIGTERM would when the process that started it dies.

    `parent`: its process id. With it, a child whose parent is dead already ends at once. As the initializer of a worker
    it imports little, so that such a child ends before it imports the rest.
    """
    _libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)
    if parent is not None and os.getppid() != parent:
        os.kill(os.getpid(), signal.SIGTERM)
