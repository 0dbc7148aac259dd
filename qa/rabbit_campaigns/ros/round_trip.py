"""The floor of a graph in lock-step: two nodes in two processes, which answer each other and do nothing else."""

import os
import subprocess
import sys
import time

import rclpy
from rabbit_common.ros.network import initialise
from rabbit_common.ros.qos import TICK
from rabbit_msgs.msg import RabbitState, TorqueCommand
from rclpy.context import Context
from rclpy.experimental import EventsExecutor

ROUND_TRIPS = 2000
PATIENCE = 60.0  # s for the two to find each other


def measure_round_trips() -> list[float]:
    """Seconds of each round trip: a state's message there, a torque's back, nothing read of either.

    Raises:
        TimeoutError: the other process is not found.
    """
    namespace = f"/bare_{os.getpid()}"
    other = subprocess.Popen([sys.executable, "-m", __name__, namespace], stdin=subprocess.PIPE)
    context = Context()
    initialise(context, args=[])
    node = rclpy.create_node("asks", namespace=namespace, context=context)
    states, seconds = node.create_publisher(RabbitState, "state", TICK), list[float]()
    executor, sent = EventsExecutor(context=context), 0.0
    executor.add_node(node)

    def ask() -> None:
        nonlocal sent
        sent = time.perf_counter()
        states.publish(RabbitState())

    def on_answer(_: bytes) -> None:
        seconds.append(time.perf_counter() - sent)
        ask()

    answers = node.create_subscription(TorqueCommand, "torque", on_answer, TICK, raw=True)
    try:
        end = time.monotonic() + PATIENCE
        while not (states.get_subscription_count() and answers.get_publisher_count()):
            executor.spin_once(0.1)
            if time.monotonic() > end:
                raise TimeoutError(f"two bare nodes have not found each other in {PATIENCE:g} s")
        while len(seconds) < ROUND_TRIPS:
            if not seconds:
                ask()  # again: the other may know this reader a little later
            executor.spin_once(0.5)
    finally:
        other.communicate()
        executor.shutdown()
        node.destroy_node()
        rclpy.try_shutdown(context=context)
    return seconds


def answer(namespace: str) -> None:
    """Answer each state until stdin is closed."""
    initialise(args=[])
    node = rclpy.create_node("answers", namespace=namespace)
    torques = node.create_publisher(TorqueCommand, "torque", TICK)
    node.create_subscription(RabbitState, "state", lambda _: torques.publish(TorqueCommand()), TICK, raw=True)
    executor = EventsExecutor()
    executor.add_node(node)
    os.set_blocking(sys.stdin.fileno(), False)
    while sys.stdin.buffer.read() != b"":  # None while it is open
        executor.spin_once(0.1)


if __name__ == "__main__":
    answer(sys.argv[1])
