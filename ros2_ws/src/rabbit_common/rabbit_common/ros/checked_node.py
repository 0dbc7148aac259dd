"""Nodes that report what they cannot read: the middleware itself drops such bytes without a word.

Deadline and liveliness of a topic are parameters of ROS: `qos_overrides./state.subscription.deadline`, ns, and so on.
What is missed is counted as a refused message is.
"""

import re
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from copy import copy
from functools import wraps
from typing import Any, ParamSpec

from rclpy.event_handler import PublisherEventCallbacks, SubscriptionEventCallbacks
from rclpy.exceptions import InvalidParameterTypeException
from rclpy.impl.implementation_singleton import rclpy_implementation
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSPolicyKind, QoSProfile
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.serialization import deserialize_message
from rclpy.subscription import Subscription

from rabbit_common.guard import guarded
from rabbit_common.message_checks import MessageCounter, Refused
from rabbit_common.ros.parameters import ParameterError

MOST_BYTES = 10_000_000  # of a message; the largest carries a policy file, of which 8 MB are read

P = ParamSpec("P")
FAULT = "fault of this node"  # reason of a refusal that no check foresaw
WATCHED = (QoSPolicyKind.DEADLINE, QoSPolicyKind.LIVELINESS, QoSPolicyKind.LIVELINESS_LEASE_DURATION)

_BOUND = re.compile(r"string<(\d+)>$|sequence<.*, (\d+)>$")


class CheckedNode(Node):
    """A node that counts what it hears, and refuses with a line what it cannot use."""

    def __init__(self, name: str) -> None:
        super().__init__(name)
        self._message_counter = MessageCounter()

    def _hear(self, kind: Any, topic: str, callback: Callable[[Any], None], qos: QoSProfile) -> Subscription:
        """Subscribe to `topic`; what is no message of this kind, or what `callback` refuses, is refused."""
        limits = bounds(kind)
        take = self._guarded(topic, lambda data: callback(decoded(data, kind, limits)))
        return self.create_subscription(kind, topic, take, qos, raw=True)

    def create_subscription(self, msg_type: Any, topic: str, callback: Any, qos_profile: Any, **named: Any) -> Any:
        """Subscribes as rclpy does, with deadline and liveliness where parameters give them."""
        with self._watched(topic, "subscription", SubscriptionEventCallbacks, qos_profile) as (qos, watched):
            return super().create_subscription(msg_type, topic, callback, qos, **named, **watched)

    def create_publisher(self, msg_type: Any, topic: str, qos_profile: Any, **named: Any) -> Publisher:
        """Likewise."""
        with self._watched(topic, "publisher", PublisherEventCallbacks, qos_profile) as (qos, watched):
            return super().create_publisher(msg_type, topic, qos, **named, **watched)

    @contextmanager
    def _watched(self, topic: str, end: str, callbacks: Any, qos: Any) -> Iterator[tuple[Any, dict[str, Any]]]:
        """QoS and options of one end of a topic; raises `ParameterError` where a parameter has another type."""
        known = f"qos_overrides.{self.resolve_topic_name(topic)}.{end}."
        if not any(name.startswith(known) for name in self._parameter_overrides):
            yield qos, {}
            return

        def late(event: Any) -> None:
            self._refuse(topic, Refused("deadline missed", f"{event.total_count} times"))

        def silent(event: Any) -> None:
            if getattr(event, "not_alive_count", 1):  # a reader hears that a writer lives, too
                self._refuse(topic, Refused("not alive", "its writer has not been heard for its lease"))

        events = callbacks(deadline=late, liveliness=silent)
        try:
            yield copy(qos), {"qos_overriding_options": QoSOverridingOptions(WATCHED), "event_callbacks": events}
        except InvalidParameterTypeException as error:
            raise ParameterError(f"parameter {known}*: {str(error).strip()}") from error

    def _guarded(self, topic: str, use: Callable[P, object]) -> Callable[P, None]:
        """`use`, which refuses what came in where it raises `Refused`, or anything else, which is a fault of ours."""

        @wraps(use)  # its signature says whether it wants to know when a message was sent
        def try_to_use(*arguments: P.args, **named: P.kwargs) -> None:
            try:
                use(*arguments, **named)
            except Refused as error:
                self._refuse(topic, error)

        def fail(reason: str, /, *_: P.args, **__: P.kwargs) -> None:
            self._refuse(topic, Refused(FAULT, reason))
            self._on_fault(f"{topic}: {reason}")

        return guarded(try_to_use, fail)

    def _on_fault(self, reason: str) -> None:
        """What came in was used in part, perhaps, and then a fault of ours was met. Most nodes just go on."""

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
