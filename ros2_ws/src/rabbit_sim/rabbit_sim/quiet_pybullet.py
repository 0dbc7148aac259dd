"""PyBullet, imported without the line that it prints: many processes would print it into a progress bar."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from functools import partial
from typing import Any

STDERR = 2


@contextmanager
def _silenced_stderr() -> Iterator[None]:
    """What C code writes to stderr goes nowhere."""
    sys.stderr.flush()
    kept, sink = os.dup(STDERR), os.open(os.devnull, os.O_WRONLY)
    os.dup2(sink, STDERR)
    try:
        yield
    finally:
        os.dup2(kept, STDERR)
        os.close(kept)
        os.close(sink)


with _silenced_stderr():
    import pybullet

__all__ = ["PhysicsClient", "pybullet"]


class PhysicsClient:
    """PyBullet's functions in a physics world of one's own, without graphics. (`pybullet_utils`' own client prints.)"""

    def __init__(self) -> None:
        self._client: int = pybullet.connect(pybullet.DIRECT)

    def __getattr__(self, name: str) -> Any:
        function = partial(getattr(pybullet, name), physicsClientId=self._client)
        setattr(self, name, function)  # so that it is made once
        return function
