"""One question to a running graph: `rabbit policy load FILE` asks the controller."""

from pathlib import Path

import rclpy
from rabbit_msgs.srv import LoadPolicy
from rabbit_ros.ros.services import call_service
from rclpy.executors import SingleThreadedExecutor

from rabbit_cli.executables import LaunchError
from rabbit_cli.ros.context import joined


def load_policy(path: Path, namespace: str = "", timeout: float = 5.0) -> LoadPolicy.Response:
    """Have the running controller check a policy file and put it in force between two ticks.

    Returns:
        The controller's answer: the policy's `version`, or, where it is not `accepted`, why not in `message`.

    Raises:
        LaunchError: no controller answers within `timeout` s.
        Refused: the environment cannot be used.
    """
    with joined("/rabbit/operator") as context:
        node = rclpy.create_node("question", namespace=namespace, context=context)
        client = node.create_client(LoadPolicy, "load_policy")
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        answer = call_service(client, LoadPolicy.Request(path=str(path.absolute())), executor.spin_once, timeout)
        if answer is None:
            raise LaunchError(f"no answer from {client.service_name} after {timeout:g} s: is the graph running?")
        return answer
