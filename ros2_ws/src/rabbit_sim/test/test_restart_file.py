"""What the simulator noted is there after it was killed."""

import os
import signal
from pathlib import Path

from rabbit_sim.restart_file import RestartFile, RestartPoint


def test_a_killed_process_has_noted_all(tmp_path: Path) -> None:
    path = tmp_path / "new" / "memory"
    child = os.fork()
    if child == 0:
        memory = RestartFile(path)
        for tick in range(1000):
            memory.note(**vars(RestartPoint(3, tick, 5000 + tick, True, 2, 2**64 - 1, 0.5, "ba639a4ab431")))
        os.kill(os.getpid(), signal.SIGKILL)
    os.waitpid(child, 0)
    assert RestartFile(path).stand == RestartPoint(3, 999, 5999, True, 2, 2**64 - 1, 0.5, "ba639a4ab431")


def test_the_first_one_begins_at_zero(tmp_path: Path) -> None:
    assert RestartFile(tmp_path / "memory").stand == RestartFile(None).stand == RestartPoint()
