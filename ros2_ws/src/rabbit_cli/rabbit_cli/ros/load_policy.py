"""One question to a running graph: `rabbit policy load FILE` asks the controller."""

from contextlib import closing
from pathlib import Path

from rabbit_msgs.srv import LoadPolicy

from rabbit_cli.executables import LaunchError
from rabbit_cli.ros.client import GraphClient


def load_policy(path: Path, namespace: str = "", timeout: float = 5.0) -> LoadPolicy.Response:
    """Have the running controller check a policy file and put it in force between two ticks.

    Returns:
        The controller's answer: the policy's `version`, or, where it is not `accepted`, why not in `message`.

    Raises:
        LaunchError: no controller answers within `timeout` s.
        Refused: the environment cannot be used.
    """
    with closing(GraphClient("question", namespace)) as client:
        answer = client.ask("load_policy", timeout, path=str(path.absolute()))
        if answer is None:
            name = client.node.resolve_service_name("load_policy")
            raise LaunchError(f"no answer from {name} after {timeout:g} s: is the graph running?")
        return answer
