"""Nodes that report what they cannot read: the middleware itself drops such bytes without a word."""

import re
from collections.abc import Callable
from typing import Any

from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.qos import QoSProfile
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription

from rabbit_common.message_checks import MessageCounter, Refused

MOST_BYTES = 10_000_000  # of a message; the largest carries a policy file, of which 8 MB are read

_BOUND = re.compile(r"string<(\d+)>$|sequence<.*, (\d+)>$")


class CheckedNode(Node):
    """A node that counts what it hears, and refuses with a line what it cannot use."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._message_counter = MessageCounter()

    def _hear(self, kind: Any, topic: str, callback: Callable[[Any], None], qos: QoSProfile) -> Subscription:
        """Subscribe to `topic`; what is no message of this kind, or what `callback` refuses, is refused."""
        limits = bounds(kind)

        def take(data: bytes) -> None:
            try:
                callback(decoded(data, kind, limits))
            except Refused as error:
                self._refuse(topic, error)

        return self.create_subscription(kind, topic, take, qos, raw=True)

    def _refuse(self, topic: str, error: Refused) -> None:
        self.get_logger().warning(self._message_counter.refuse(topic, error), throttle_duration_sec=1.0)


def decoded(data: bytes, kind: Any, limits: dict[str, int]) -> Any:
    """The message in these bytes; raises `Refused`."""
    check_size(data)
    try:
        message = deserialize_message(data, kind)
    except (rclpy_implementation.RMWError, rclpy_implementation.RCLError, ValueError, MemoryError) as error:
        raise Refused("not readable", f"{len(data)} bytes are no {kind.__name__}") from error
    for name, most in limits.items():
        if (length := len(getattr(message, name))) > most:
            raise Refused("wrong length", f"{name} has {length}; expected at most {most}")
    return message


def check_size(data: bytes) -> None:
    """Refuse bytes that are too many for any message of the graph."""
    if len(data) > MOST_BYTES:
        raise Refused("too large", f"{len(data)} bytes; expected at most {MOST_BYTES}")


def bounds(kind: Any) -> dict[str, int]:
    """The bounded strings and sequences of a message: decoding does not hold them to it."""
    matches = {name: _BOUND.match(text) for name, text in kind.get_fields_and_field_types().items()}
    return {name: int(match[1] or match[2]) for name, match in matches.items() if match}
