"""One question to a running graph: `rabbit policy load FILE` asks the controller."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import rclpy
from rabbit_msgs.srv import LoadPolicy

from rabbit_bringup.launching.executables import LaunchError


@dataclass(frozen=True)
class Loaded:
    """The controller's answer: `version` is empty and `message` the reason where it refused."""

    accepted: bool
    version: str
    message: str


def load_policy(path: Path, namespace: str = "", timeout: float = 5.0) -> Loaded:
    """Have the running controller check a policy file and put it in force between two ticks.

    Raises:
        LaunchError: no controller answers.
    """
    answer = ask(LoadPolicy, "load_policy", namespace, timeout, path=str(path.absolute()))
    return Loaded(answer.accepted, answer.version, answer.message)


def ask(kind: Any, name: str, namespace: str, timeout: float, **fields: Any) -> Any:
    """Call a service once.

    Raises:
        LaunchError: nobody answers within `timeout` s.
    """
    context = rclpy.Context()
    rclpy.init(args=[], context=context)
    node = rclpy.create_node("question", namespace=namespace, context=context)
    executor = rclpy.executors.SingleThreadedExecutor(context=context)
    try:
        client = node.create_client(kind, name)
        if not client.wait_for_service(timeout_sec=timeout):
            raise LaunchError(f"no answer: nobody offers {node.resolve_service_name(name)}; is the graph running?")
        future = client.call_async(kind.Request(**fields))
        rclpy.spin_until_future_complete(node, future, executor, timeout_sec=timeout)
        if not future.done():
            raise LaunchError(f"no answer from {node.resolve_service_name(name)} within {timeout:g} s")
        return future.result()
    finally:
        node.destroy_node()
        rclpy.try_shutdown(context=context)
