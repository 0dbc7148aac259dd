"""Where policies come in, off the control path: from the topic `policy`, if it is heard, or by service, by name.

The node's own thread only takes the bytes or the name. Another thread decodes and checks them; what it decided is
handed to `decided`, which puts it in force between two ticks. The service is answered when the check is done.
"""

import queue
import threading
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

from rabbit_common.message_checks import Refused
from rabbit_common.priority import step_back
from rabbit_common.ros.checked_node import bounds, check_size, decoded
from rabbit_common.ros.qos import EVENT
from rabbit_common.ros.services import create_async_service
from rabbit_description.bounded_file import FileError, read_bytes
from rabbit_description.gait import Gaits
from rabbit_msgs.msg import PolicyWeights
from rabbit_msgs.srv import LoadPolicy
from rclpy.node import Node
from rclpy.task import Future

from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import Policy, fitted
from rl_cbf_clf_controller.weights import SIZE_LIMIT, PolicyFileError, decode, policy_path

MOST_WAITING = 20  # policies that wait for their check


@dataclass(frozen=True)
class CheckedPolicy:
    """The word on what came in: a policy ready to use, or the reason it is refused.

    `version` is computed from the bytes, whatever a message says; empty when they are no policy.
    """

    version: str
    source: str
    by_operator: bool
    policy: Policy | None
    reason: str = ""
    data: bytes = b""


class PolicyLoader:
    """Receives, checks and hands over policies."""

    def __init__(
        self,
        node: Node,
        parameters: ControllerParameters,
        gaits: Gaits,
        checked: Callable[[CheckedPolicy], None],
        hears_published: bool,
    ) -> None:
        """`decided` is called in the thread that checks."""
        self._node, self._needs, self._checked = node, (parameters, gaits), checked
        self._limits = bounds(PolicyWeights)
        self._jobs: queue.SimpleQueue[Callable[[], None] | None] = queue.SimpleQueue()
        self._thread = threading.Thread(target=self._work, name="policies", daemon=True)
        self._thread.start()
        if hears_published:  # deeper than a writer's history: with several, one must not push out another's
            node.create_subscription(PolicyWeights, "policy", self._on_bytes, EVENT, raw=True)
        create_async_service(node, LoadPolicy, "load_policy", self._on_load)

    def close(self) -> None:
        """End the thread."""
        self._jobs.put(None)
        self._thread.join(timeout=2.0)

    # In the node's thread

    def _on_bytes(self, data: bytes) -> None:
        try:
            check_size(data)
            if self._jobs.qsize() >= MOST_WAITING:
                raise Refused("too many", f"{MOST_WAITING} policies wait for their check already")
        except Refused as error:
            self._checked(CheckedPolicy("", "policy", False, None, str(error)))
            return
        self._jobs.put(partial(self._check_message, data))

    def _on_load(self, request: LoadPolicy.Request, response: LoadPolicy.Response) -> Future:
        answer = Future(executor=self._node.executor)
        self._jobs.put(partial(self._check_named, request.policy, response, answer))
        return answer

    # In the thread that checks

    def _work(self) -> None:
        step_back()  # a tick goes before a check
        while job := self._jobs.get():
            job()

    def _check_message(self, data: bytes) -> None:
        try:
            message = decoded(data, PolicyWeights, self._limits)
        except Refused as error:
            self._checked(CheckedPolicy("", "policy", False, None, str(error)))
            return
        checked = check(bytes(message.data), message.source, *self._needs)
        if checked.policy is not None and checked.version != message.version:
            text = f"the message says version {message.version}; its content has {checked.version}"
            checked = CheckedPolicy("", message.source, False, None, text)
        self._checked(checked)

    def _check_named(self, name: str, response: LoadPolicy.Response, answer: Future) -> None:
        try:
            checked = check(read_bytes(policy_path(name), SIZE_LIMIT), name, *self._needs, by_operator=True)
        except FileError as error:
            checked = CheckedPolicy("", name, True, None, f"cannot read {name}: {error}")
        self._checked(checked)
        response.success, response.message = checked.policy is not None, checked.reason
        response.version = checked.version
        answer.set_result(response)


def check(
    data: bytes, source: str, parameters: ControllerParameters, gaits: Gaits, by_operator: bool = False
) -> CheckedPolicy:
    """Decode a policy and fit it to the controller; never raises."""
    version = ""
    try:
        file = decode(data)
        version = file.version
        policy = fitted(file, parameters, gaits)
    except PolicyFileError as error:
        return CheckedPolicy(version, source, by_operator, None, str(error))
    return CheckedPolicy(version, source, by_operator, policy, "", data)
