"""A command's own node in a graph: it hears topics, publishes on them and asks services, while it spins."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import rclpy
from rcl_interfaces.srv import GetParameters, SetParameters, SetParametersAtomically
from rclpy.experimental import EventsExecutor
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.qos import QoSProfile

from rabbit_common.ros.network import joined
from rabbit_common.ros.services import AGAIN_SECONDS, call_service
from rabbit_common.ros.topics import SERVICES as SERVICES_OF_GRAPH
from rabbit_common.ros.topics import TOPICS

TOPIC = {topic.name: topic for topic in TOPICS}
SERVICES = {  # by the last part of the name
    **{service.name: service.type for service in SERVICES_OF_GRAPH},
    "get_parameters": GetParameters,
    "set_parameters": SetParameters,
    "set_parameters_atomically": SetParametersAtomically,
}


class GraphClient:
    """A node `name` in a namespace and an enclave; `check` is called while it waits, and may raise."""

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
        """Give each message of a topic to `take`, as bytes if `raw`."""
        self.node.create_subscription(TOPIC[name].type, name, take, qos or TOPIC[name].qos, raw=raw)

    @contextmanager
    def publishing(self, name: str) -> Iterator[Any]:
        """A publisher on a topic."""
        publisher = self.node.create_publisher(TOPIC[name].type, name, TOPIC[name].qos)
        try:
            yield publisher
        finally:
            self.node.destroy_publisher(publisher)

    def spin(self, seconds: float) -> None:
        """Hear what comes for so long."""
        end = time.monotonic() + seconds
        self._executor.spin_once(0.0)
        while (left := end - time.monotonic()) > 0:
            self._executor.spin_once(left)

    def comes(self, until: Callable[[], bool], seconds: float) -> bool:
        """Whether something holds within so many s."""
        end = time.monotonic() + seconds
        while not (holds := until()) and time.monotonic() <= end:
            self._listen(0.02)
        return holds

    def others(self) -> list[str]:
        """The nodes that are known by now in this namespace; those of `ros2` itself are hidden."""
        here = self.node.get_namespace()
        found = [name for name, where in self.node.get_node_names_and_namespaces() if where == here]
        return [name for name in found if name != self.node.get_name() and not name.startswith("_")]

    def client(self, name: str) -> Any:
        """The client of a service."""
        if name not in self._clients:
            self._clients[name] = self.node.create_client(SERVICES[name.split("/")[-1]], name)
        return self._clients[name]

    def ask(self, name: str, seconds: float, again: float = AGAIN_SECONDS, **fields: Any) -> Any:
        """The answer of a service; None if none comes within so many s. It is asked again after `again` s."""

        client = self.client(name)
        return call_service(client, client.srv_type.Request(**fields), self._listen, seconds, again)

    def refusals(self, node: str, values: dict[str, Any], seconds: float, atomically: bool = False) -> list[str]:
        """Set parameters of a node; why it refuses each that it does. Raises `TimeoutError` if it does not answer."""
        wanted = [Parameter(name, value=value).to_parameter_msg() for name, value in values.items()]
        answer = self._answer(f"{node}/set_parameters{'_atomically' * atomically}", seconds, parameters=wanted)
        results = [answer.result] if atomically else answer.results
        return [result.reason or "no reason" for result in results if not result.successful]

    def parameter(self, node: str, name: str, seconds: float) -> Any:
        """The value that a node has in force, None of an unknown parameter; raises `TimeoutError`."""
        answer = self._answer(f"{node}/get_parameters", seconds, names=[name])
        return parameter_value_to_python(answer.values[0]) if answer.values else None

    def _listen(self, seconds: float) -> None:
        self.check()
        self._executor.spin_once(seconds)

    def _answer(self, name: str, seconds: float, **fields: Any) -> Any:
        if (answer := self.ask(name, seconds, **fields)) is None:
            raise TimeoutError(f"no answer from {name} in {seconds:g} s")
        return answer
