"""The floor of a graph in lock-step: two nodes in two processes, which answer each other and do nothing else."""

import math
import os
import subprocess
import sys
import time
from contextlib import closing

from rabbit_common.ros.client import GraphClient
from rabbit_msgs.msg import RobotState, TorqueCommand

ROUND_TRIPS = 2000
STATE = RobotState(q=[0.0] * 7, dq=[0.0] * 7, foot_force=[0.0] * 4, contact=[True] * 2, applied=[0.0] * 4)
TORQUE = TorqueCommand(torque=[0.0] * 4)
PATIENCE = 60.0  # s for the two to find each other, and for all round trips


def measure_round_trips() -> list[float]:
    """Seconds of each round trip: a state's message there, a torque's back, nothing read of either.

    Raises:
        TimeoutError: the other process is not found.
    """
    namespace, seconds, sent = f"/bare_{os.getpid()}", list[float](), 0.0
    other = subprocess.Popen([sys.executable, "-m", __name__, namespace], stdin=subprocess.PIPE)
    with closing(GraphClient("asks", namespace, "/")) as client, client.publishing("state") as states:

        def ask() -> None:
            nonlocal sent
            sent = time.perf_counter()
            states.publish(STATE)

        def on_answer(_: bytes) -> None:
            seconds.append(time.perf_counter() - sent)
            ask()

        client.hear("torque", on_answer, raw=True)
        try:
            if not client.comes(lambda: states.get_subscription_count() > 0, PATIENCE):
                raise TimeoutError(f"two bare nodes have not found each other in {PATIENCE:g} s")
            ask()
            while not client.comes(lambda: bool(seconds), 0.5):
                ask()  # again: the other may know this reader a little later
            client.comes(lambda: len(seconds) >= ROUND_TRIPS, PATIENCE)
        finally:
            other.communicate()
    return seconds


def answer(namespace: str) -> None:
    """Answer each state until stdin is closed."""
    with closing(GraphClient("answers", namespace, "/")) as client, client.publishing("torque") as torques:
        client.hear("state", lambda _: torques.publish(TORQUE), raw=True)
        os.set_blocking(sys.stdin.fileno(), False)
        client.comes(lambda: sys.stdin.buffer.read() == b"", math.inf)  # None while it is open


if __name__ == "__main__":
    answer(sys.argv[1])
