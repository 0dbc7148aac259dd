"""Where policies come in: from the topic `policy`, if it is heard, or, by service, from a file. Off the control path.

This second node of the controller's process has a thread of its own, in which the bytes are received, decoded and
checked; what it decided is handed to `decided`, which puts it in force between two ticks.
"""

import threading
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from rabbit_description.gait_library import Gaits
from rabbit_msgs.msg import PolicyWeights
from rabbit_msgs.srv import LoadPolicy
from rabbit_ros.door import Refused
from rabbit_ros.hearing_node import hear
from rabbit_ros.priority import be_ordinary
from rabbit_ros.qos_node import EVENT
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node

from rl_cbf_clf_controller.fitting import fitted
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import Policy
from rl_cbf_clf_controller.weights import PolicyFileError, decode

MOST_BYTES = 100_000_000  # of a policy file; the shipped ones have half a million


@dataclass(frozen=True)
class Decided:
    """The word on what came in: a policy ready to use, or the reason it is refused.

    `version` is computed from the bytes, whatever a message says; empty when they are no policy.
    """

    version: str
    source: str
    by_operator: bool
    policy: Policy | None
    reason: str = ""
    data: bytes = b""


class PolicyIntake(Node):
    """Receives, checks and hands over policies."""

    def __init__(
        self, law: ControllerParameters, gaits: Gaits, decided: Callable[[Decided], None], hears_published: bool
    ) -> None:
        super().__init__("controller_policies", start_parameter_services=False, enable_rosout=False)
        self._needs, self._decided = (law, gaits), decided
        if hears_published:  # deeper than a writer's history: with several, one must not push out another's
            hear(self, PolicyWeights, "policy", self._on_weights, EVENT, self._refuse)
        self.create_service(LoadPolicy, "load_policy", self._on_load)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self)
        self._thread = threading.Thread(target=self._spin, name="policies", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """End the thread."""
        self._executor.shutdown()
        self._thread.join(timeout=2.0)
        self.destroy_node()

    def _spin(self) -> None:
        be_ordinary()  # a check must not keep a tick waiting
        with suppress(ExternalShutdownException):
            self._executor.spin()

    def _refuse(self, topic: str, error: Refused) -> None:
        self._decided(Decided("", topic, False, None, str(error)))

    def _on_weights(self, message: PolicyWeights) -> None:
        decided = check(bytes(message.data), message.source, *self._needs)
        if decided.policy is not None and decided.version != message.version:
            text = f"the message says version {message.version}; its content has {decided.version}"
            decided = Decided("", message.source, False, None, text)
        self._decided(decided)

    def _on_load(self, request: LoadPolicy.Request, response: LoadPolicy.Response) -> LoadPolicy.Response:
        try:
            decided = check(_content(Path(request.path)), request.path, *self._needs, by_operator=True)
        except (OSError, ValueError) as error:
            decided = Decided("", request.path, True, None, f"cannot read {request.path}: {error}")
        self._decided(decided)
        response.accepted, response.message = decided.policy is not None, decided.reason
        response.version = decided.version
        return response


def _content(path: Path) -> bytes:
    """Of a file that may be a policy: the path is anybody's, and may name a device or a pipe that never ends."""
    if path.exists() and not path.is_file():
        raise ValueError("expected a regular file, not a directory, device or pipe")
    if (size := path.stat().st_size) > MOST_BYTES:
        raise ValueError(f"{size} bytes: expected {MOST_BYTES} at most")
    return path.read_bytes()


def check(data: bytes, source: str, law: ControllerParameters, gaits: Gaits, by_operator: bool = False) -> Decided:
    """Decode a policy and fit it to the controller; never raises."""
    version = ""
    try:
        file = decode(data)
        version = file.version
        policy = fitted(file, law, gaits)
    except PolicyFileError as error:
        return Decided(version, source, by_operator, None, str(error))
    return Decided(version, source, by_operator, policy, "", data)
