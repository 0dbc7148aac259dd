"""PyBullet, imported without the line that it prints: many processes would print it into a progress bar."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager

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
    from pybullet_utils.bullet_client import BulletClient

__all__ = ["BulletClient", "pybullet"]
