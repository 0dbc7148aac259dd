"""Kill the controller at a random moment of a walk in real time: how soon does the safe action act?

    killed    the last torque held for two ticks    the joints damped
    |------------------------------------------------|------------------

The simulator tells of each tick (`timing`) when it has simulated it, which is when the next one begins. So damping acts
from when the last held tick is told.
"""

import os
import random
import signal
import time
from dataclasses import dataclass
from itertools import takewhile

import rclpy
from rabbit_bringup.launching.walk import Graph, WalkOptions
from rabbit_cli.executables import LaunchError
from rabbit_description.state import TICK_SECONDS
from rabbit_msgs.msg import Timing
from rabbit_ros.ros.network import initialise
from rabbit_ros.ros.topics import TOPICS
from rclpy.executors import SingleThreadedExecutor

from rabbit_campaigns.node_usage import node_processes
from rabbit_campaigns.timed_walk import do_once

EARLIEST = 50  # ticks walked before the kill
PATIENCE = 10.0  # s from the kill to the first damped tick


@dataclass(frozen=True)
class Death:
    """Ticks held; ms by the wall clock from the kill until damping acts, and until its first tick was simulated."""

    held: int
    until_damping_ms: float
    until_simulated_ms: float


def die(graph: Graph, request: WalkOptions, rng: random.Random) -> Death:
    """Walk, kill the controller, and listen.

    Raises:
        LaunchError: a node cannot be started or is not ready in time, or the joints are not damped.
        Interrupted: by a signal.
    """
    ear = Ear(graph.namespace)
    try:
        return do_once(graph, request, EARLIEST, lambda: _kill(graph, ear, rng))
    finally:
        ear.close()


def _kill(graph: Graph, ear: "Ear", rng: random.Random) -> Death:
    process = node_processes(graph.folder, graph.names)["controller"]
    time.sleep(rng.uniform(0, TICK_SECONDS))
    killed = time.monotonic()
    os.kill(process, signal.SIGKILL)
    while not ear.told or ear.told[-1][1] != Timing.DAMPING:
        ear.spin(TICK_SECONDS)
        if time.monotonic() - killed > PATIENCE:
            raise LaunchError(f"the joints are not damped {PATIENCE:g} s after the controller was killed")
    *before, (damped, _) = ear.told
    held = [at for at, _ in takewhile(lambda tick: tick[1] == Timing.HELD, reversed(before))]
    return Death(len(held), (held[0] - killed) * 1e3, (damped - killed) * 1e3)


class Ear:
    """Hears `timing`; `told`: when each tick was told of, and what acted in it."""

    def __init__(self, namespace: str) -> None:
        self._context = rclpy.Context()
        initialise(self._context)
        self._node = rclpy.create_node("ear", namespace=namespace, context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self.told: list[tuple[float, int]] = []
        (topic,) = (topic for topic in TOPICS if topic.name == "timing")
        self._node.create_subscription(topic.type, topic.name, self._on_timing, topic.qos)

    def spin(self, seconds: float) -> None:
        """Hear one message, or none in so long."""
        self._executor.spin_once(seconds)

    def close(self) -> None:
        """Leave the graph."""
        self._executor.shutdown()
        self._node.destroy_node()
        rclpy.try_shutdown(context=self._context)

    def _on_timing(self, message: Timing) -> None:
        self.told.append((time.monotonic(), message.source))
