"""A command's node in a graph: it hears topics and asks services, while it spins."""

import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from typing import Any, ClassVar

import rclpy
from rclpy.experimental import EventsExecutor
from rclpy.qos import QoSProfile

from rabbit_common.ros.network import joined
from rabbit_common.ros.services import AGAIN_SECONDS, call_service
from rabbit_common.ros.topics import SERVICES, TOPICS

TOPIC = {topic.name: topic for topic in TOPICS}
SERVICE_TYPES = {service.name: service.type for service in SERVICES}


class GraphClient:
    """A node `name` in a namespace and an enclave; `check` is called while it waits, and may raise.

    `service_types`: by the last part of a service's name.
    """

    service_types: ClassVar[Mapping[str, Any]] = SERVICE_TYPES

    def __init__(
        self, name: str, namespace: str, enclave: str = "/rabbit/operator", check: Callable[[], object] = lambda: None
    ) -> None:
        """Raises `StartError`."""
        self._stack = ExitStack()
        self.context = self._stack.enter_context(joined(enclave))
        self.node = rclpy.create_node(name, namespace=namespace, context=self.context)
        self._executor = EventsExecutor(context=self.context)
        self._executor.add_node(self.node)
        self._clients: dict[str, Any] = {}
        self.check = check

    def close(self) -> None:
        """Leave the graph."""
        self._executor.remove_node(self.node)
        self._executor.shutdown()
        self.node.destroy_node()
        self._stack.close()

    def hear(self, name: str, take: Callable[[Any], None], qos: QoSProfile | None = None, raw: bool = False) -> None:
        """Give the messages of a topic to `take`, as bytes if `raw`."""
        self.node.create_subscription(TOPIC[name].type, name, take, qos or TOPIC[name].qos, raw=raw)

    def spin(self, seconds: float) -> None:
        """Hear what comes for so long."""
        end = time.monotonic() + seconds
        self._executor.spin_once(0.0)
        while (left := end - time.monotonic()) > 0:
            self._executor.spin_once(left)

    def others(self) -> list[str]:
        """The nodes that are known by now in this namespace; those of `ros2` itself are hidden."""
        here, this = self.node.get_namespace(), self.node.get_name()
        names = [name for name, where in self.node.get_node_names_and_namespaces() if where == here]
        return [name for name in names if name != this and not name.startswith("_")]

    def client(self, name: str) -> Any:
        """The client of a service."""
        if name not in self._clients:
            self._clients[name] = self.node.create_client(self.service_types[name.split("/")[-1]], name)
        return self._clients[name]

    def ask(self, name: str, seconds: float, again: float = AGAIN_SECONDS, **fields: Any) -> Any:
        """The answer of a service; None if none comes within so many s. It is asked again after `again` s."""
        client = self.client(name)
        return call_service(client, client.srv_type.Request(**fields), self._listen, seconds, again)

    def _listen(self, seconds: float) -> None:
        self.check()
        self._executor.spin_once(seconds)
