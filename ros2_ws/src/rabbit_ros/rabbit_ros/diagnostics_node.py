"""Diagnostics of a node: its state in one line and the counts of what it took and refused, once a second."""

from collections.abc import Callable, Mapping

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.node import Node

from rabbit_ros.door import Door
from rabbit_ros.qos_node import DIAGNOSTICS
from rabbit_ros.spin_node import steady_timer

OK, WARN, ERROR = DiagnosticStatus.OK, DiagnosticStatus.WARN, DiagnosticStatus.ERROR
Status = tuple[bytes, str, Mapping[str, object]]  # level, line, figures


class Diagnostics:
    """Publishes on `diagnostics` what `status` says, with the door's counts; a refusal is a warning for one period."""

    def __init__(self, node: Node, door: Door, status: Callable[[], Status], period: float = 1.0) -> None:
        self._node, self._door, self._status = node, door, status
        self._publisher = node.create_publisher(DiagnosticArray, "diagnostics", DIAGNOSTICS)
        self._told = 0
        steady_timer(node, period, self.publish)

    def publish(self) -> None:
        """One message, now."""
        level, line, figures = self._status()
        refused = sum(self._door.refused.values())
        if refused > self._told and level == OK:
            level, line = WARN, self._door.last_refusal
        self._told = refused
        counts = {f"accepted {topic}": n for topic, n in self._door.accepted.items()}
        counts |= {f"refused {name}": n for name, n in self._door.refused.items()}
        values = [KeyValue(key=key, value=str(value)) for key, value in {**figures, **counts}.items()]
        name = self._node.get_fully_qualified_name()
        status = DiagnosticStatus(level=level, name=name, hardware_id="rabbit", message=line, values=values)
        self._publisher.publish(DiagnosticArray(status=[status]))
