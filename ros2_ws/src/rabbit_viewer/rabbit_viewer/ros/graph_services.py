"""Passes on to the graph's services what a browser asks, and says what they answer."""

from collections.abc import Callable
from functools import partial
from typing import Any

from rabbit_msgs.srv import LoadPolicy, Pause, ResetEpisode
from rclpy.node import Node
from rclpy.task import Future

from rabbit_viewer.live.messages import Asked
from rabbit_viewer.live.messages import Pause as AskedPause
from rabbit_viewer.live.messages import Reset as AskedReset


class GraphServices:
    """`say` gets a line for each answer."""

    def __init__(self, node: Node, say: Callable[[str], None]) -> None:
        self._say = say
        kinds = {"pause": Pause, "reset_episode": ResetEpisode, "load_policy": LoadPolicy}
        self._clients = {name: node.create_client(kind, name) for name, kind in kinds.items()}

    def ask(self, asked: Asked) -> None:
        """Call the service; the answer comes later."""
        if isinstance(asked, AskedPause):
            self._call("pause", Pause.Request(paused=asked.paused))
        elif isinstance(asked, AskedReset):
            self._call("reset_episode", ResetEpisode.Request(seed=asked.seed))
        else:
            self._call("load_policy", LoadPolicy.Request(path=asked.path))

    def _call(self, name: str, request: Any) -> None:
        client = self._clients[name]
        if not client.service_is_ready():
            self._say(f"{name}: no such service in this graph")
            return
        client.call_async(request).add_done_callback(partial(self._on_answer, name))

    def _on_answer(self, name: str, answer: Future) -> None:
        response: Any = answer.result()
        word = "accepted" if response.accepted else "refused"
        self._say(f"{name}: {word}{f', {response.message}' if response.message else ''}")
