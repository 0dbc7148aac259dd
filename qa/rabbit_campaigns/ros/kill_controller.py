"""Kill the controller at a random moment of a walk in real time: how soon does the safe action act?

    killed    the last torque held for two ticks    the joints damped
    |------------------------------------------------|------------------

The simulator tells of each tick (`timing`) when it has simulated it, which is when the next one begins. So damping acts
from when the last held tick is told.
"""

import random
import signal
import time
from contextlib import closing
from dataclasses import dataclass
from itertools import takewhile
from typing import Any

from rabbit_bringup.launching.walk import WalkSettings
from rabbit_bringup.ros.walking import walking
from rabbit_common.executables import LaunchError
from rabbit_common.ros.client import GraphClient
from rabbit_description.state import TICK_SECONDS
from rabbit_msgs.msg import Timing

EARLIEST = 50  # ticks walked before the kill
PATIENCE = 10.0  # s from the kill to the first damped tick


@dataclass(frozen=True)
class Death:
    """Ticks held; ms by the wall clock from the kill until damping acts, and until its first tick was simulated."""

    held: int
    until_damping_ms: float
    until_simulated_ms: float


def die(walk: WalkSettings, rng: random.Random) -> Death:
    """Walk, kill the controller, and listen.

    Raises:
        LaunchError: a node cannot be started or is not ready in time, or the joints are not damped.
        Interrupted: by a signal.
    """
    told: list[tuple[float, int]] = []  # when each tick was told of, and what acted in it

    def on_timing(message: Any) -> None:
        told.append((time.monotonic(), message.source))

    with closing(GraphClient("ear", walk.options.namespace, "/")) as ear, walking(walk) as monitor:
        ear.hear("timing", on_timing)
        while len(told) < EARLIEST:
            monitor.check()
            ear.spin(TICK_SECONDS)
        time.sleep(rng.uniform(0, TICK_SECONDS))
        killed = time.monotonic()
        monitor.processes.send("controller", signal.SIGKILL)
        if not ear.comes(lambda: bool(told) and told[-1][1] == Timing.DAMPING, PATIENCE):
            raise LaunchError(f"the joints are not damped {PATIENCE:g} s after the controller was killed")
    first = [source for _, source in told].index(Timing.DAMPING)
    held = [at for at, _ in takewhile(lambda tick: tick[1] == Timing.HELD, reversed(told[:first]))]
    return Death(len(held), (held[0] - killed) * 1e3, (told[first][0] - killed) * 1e3)
