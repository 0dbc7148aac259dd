"""One question to a running graph: `rabbit policy load FILE` asks the controller."""

from pathlib import Path

import rclpy
from rabbit_msgs.srv import LoadPolicy
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions

from rabbit_bringup.launching.executables import LaunchError


def load_policy(path: Path, namespace: str = "", timeout: float = 5.0) -> LoadPolicy.Response:
    """Have the running controller check a policy file and put it in force between two ticks.

    Returns:
        The controller's answer: the policy's `version`, or, where it is not `accepted`, why not in `message`.

    Raises:
        LaunchError: no controller answers within `timeout` s, twice: to be found, and to answer.
    """
    context = rclpy.Context()
    rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = rclpy.create_node("question", namespace=namespace, context=context)
        client = node.create_client(LoadPolicy, "load_policy")
        if not client.wait_for_service(timeout_sec=timeout):
            raise LaunchError(f"no controller offers {client.service_name} after {timeout:g} s: is the graph running?")
        answer = client.call_async(LoadPolicy.Request(path=str(path.absolute())))
        rclpy.spin_until_future_complete(node, answer, SingleThreadedExecutor(context=context), timeout)
        if not answer.done():
            raise LaunchError(f"no answer from {client.service_name} after {timeout:g} s")
        return answer.result()
    finally:
        rclpy.try_shutdown(context=context)
