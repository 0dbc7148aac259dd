"""The launcher's own priority, which the nodes that it starts begin with."""

import contextlib
import sys
from collections.abc import Iterator

from rabbit_ros.priority import leave_priority, take_listeners_priority


@contextlib.contextmanager
def listening_to(priority: int) -> Iterator[None]:
    """Meanwhile be just beneath simulator and controller of this priority, where permitted; 0 changes nothing."""
    take_listeners_priority(priority, warn=lambda line: print(line, file=sys.stderr))
    try:
        yield
    finally:
        if priority:
            leave_priority()
