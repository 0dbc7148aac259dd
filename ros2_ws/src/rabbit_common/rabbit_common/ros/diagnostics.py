"""Diagnostics of a node: its state in one line and the counts of what it took and refused.

Once a second, and within 0.1 s of a change between OK, WARN and ERROR or in the number of readers of its topics: the
launcher waits for both before it lets a walk begin.
"""

import math
import time
from collections.abc import Callable, Mapping
from contextlib import suppress

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node
from std_msgs.msg import Header

from rabbit_common.message_checks import MessageCounter
from rabbit_common.ros.qos import DIAGNOSTICS
from rabbit_common.ros.spin import steady_timer
from rabbit_common.ros.topics import TOPICS

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
LOOK_SECONDS = 0.1
PERIOD_SECONDS = 1.0
READERS = "readers of "
Status = tuple[bytes, str, Mapping[str, object]]  # level, line, figures
BARRIER = "barrier "  # before a barrier's name, of the figure that is its value


class Diagnostics:
    """Publishes on `diagnostics` what `status` says, with the message counts; a refusal is a warning for one period."""

    def __init__(self, node: Node, counter: MessageCounter, status: Callable[[], Status]) -> None:
        self._node, self._counter, self._status = node, counter, status
        self._publisher = node.create_publisher(DiagnosticArray, "diagnostics", DIAGNOSTICS)
        self._names = {node.resolve_topic_name(topic.name): topic.name for topic in TOPICS}  # before remapping
        self._reported = 0
        self._seen: tuple[bytes, dict[str, int]] = (b"", {})
        self._since = 0.0
        steady_timer(node, LOOK_SECONDS, self._look)

    def _look(self) -> None:
        level, line, figures = self._status()
        topics = {self._names.get(p.topic_name): p.get_subscription_count() for p in self._node.publishers}
        readers = {f"{READERS}{name}": count for name, count in topics.items() if name}
        if self._seen != (level, readers) or time.monotonic() - self._since >= PERIOD_SECONDS:
            self._seen, self._since = (level, readers), time.monotonic()
            self._publish(level, line, {**figures, **readers})

    def _publish(self, level: bytes, line: str, figures: Mapping[str, object]) -> None:
        refused = sum(self._counter.refused.values())
        if refused > self._reported:
            line = self._counter.last_refusal if level == OK else f"{line}; {self._counter.last_refusal}"
            level = max(level, WARN)
        self._reported = refused
        counts = {f"accepted {topic}": n for topic, n in self._counter.accepted.items()}
        counts |= {f"refused {name}": n for name, n in self._counter.refused.items()}
        values = [KeyValue(key=key, value=str(value)) for key, value in {**figures, **counts}.items()]
        name = self._node.get_fully_qualified_name()
        status = DiagnosticStatus(level=level, name=name, hardware_id="rabbit", message=line, values=values)
        header = Header(stamp=self._node.get_clock().now().to_msg())
        self._publisher.publish(DiagnosticArray(header=header, status=[status]))


def reader_counts(status: DiagnosticStatus) -> dict[str, int]:
    """How many readers a node says its topics have, by the topic's name before remapping."""
    names = [value.key for value in status.values if value.key.startswith(READERS)]
    counts = {name.removeprefix(READERS): figure(status, name) for name in names}
    return {name: int(count) for name, count in counts.items() if math.isfinite(count)}


def figure(status: DiagnosticStatus, name: str) -> float:
    """A number that a node says of itself; NaN where it says none."""
    with suppress(ValueError):
        return next((float(value.value) for value in status.values if value.key == name), math.nan)
    return math.nan
