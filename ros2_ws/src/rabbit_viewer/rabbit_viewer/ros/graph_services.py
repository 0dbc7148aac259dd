"""Passes on to the graph's services what a browser asks, and says what they answer."""

from collections.abc import Callable
from functools import partial
from typing import Any

from rabbit_msgs.srv import LoadPolicy, ResetEpisode
from rclpy.node import Node
from rclpy.task import Future
from std_srvs.srv import SetBool

from rabbit_viewer.live.graph_page import Asked

SERVICES = {"pause": ("pause", SetBool), "reset": ("reset_episode", ResetEpisode), "load": ("load_policy", LoadPolicy)}


class GraphServices:
    """`say` gets a line for each answer."""

    def __init__(self, node: Node, say: Callable[[str], None]) -> None:
        self._say = say
        self._clients = {name: node.create_client(kind, name) for name, kind in SERVICES.values()}

    def ask(self, asked: Asked) -> None:
        """Call the service; the answer comes later."""
        name, kind = SERVICES[asked.do]
        client = self._clients[name]
        if client.service_is_ready():
            request = kind.Request(**asked.model_dump(exclude={"do"}, by_alias=True))
            client.call_async(request).add_done_callback(partial(self._on_answer, name))
        else:
            self._say(f"{name}: no such service in this graph")

    def _on_answer(self, name: str, answer: Future) -> None:
        response: Any = answer.result()
        word = "accepted" if response.success else "refused"
        self._say(f"{name}: {word}{f', {response.message}' if response.message else ''}")
