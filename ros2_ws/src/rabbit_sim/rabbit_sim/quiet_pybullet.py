"""PyBullet, imported without the line that it prints: many processes would print it into a progress bar."""

import os
import sys
from functools import partial
from typing import Any

STDERR = 2  # of the process, where C code writes

sys.stderr.flush()
_kept, _nowhere = os.dup(STDERR), os.open(os.devnull, os.O_WRONLY)
os.dup2(_nowhere, STDERR)
try:
    import pybullet
finally:
    os.dup2(_kept, STDERR)
    os.close(_kept)
    os.close(_nowhere)

__all__ = ["PhysicsClient", "pybullet"]


class PhysicsClient:
    """PyBullet's functions in a physics world of one's own, without graphics. (`pybullet_utils`' own client prints.)"""

    def __init__(self) -> None:
        self._client: int = pybullet.connect(pybullet.DIRECT)

    def __getattr__(self, name: str) -> Any:
        function = partial(getattr(pybullet, name), physicsClientId=self._client)
        setattr(self, name, function)  # so that it is made once
        return function
