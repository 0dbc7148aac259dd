"""Asks the graph's controller and simulator for the parameters that the drawing needs, at each episode's start."""

from dataclasses import fields
from functools import partial
from typing import Any

from rabbit_common.ros.spin import steady_timer
from rcl_interfaces.msg import ParameterType
from rcl_interfaces.srv import GetParameters
from rclpy.node import Node
from rclpy.task import Future

from rabbit_viewer.live.snapshot import Limits

ASKED = {
    "controller": tuple(each.name for each in fields(Limits) if each.name != "link_bend"),
    "simulator": ("link_bend",),
}
TRY_SECONDS = 0.5  # until there is an answer


class GraphLimits:
    """`known` is None until both have answered."""

    def __init__(self, node: Node) -> None:
        self.known: Limits | None = None
        self._values: dict[str, float] = {}
        self._clients = {name: node.create_client(GetParameters, f"{name}/get_parameters") for name in ASKED}
        self._open = set(ASKED)
        steady_timer(node, TRY_SECONDS, self._try)

    def ask_again(self) -> None:
        """Another graph may be walking; what is known holds until the answers."""
        self._open = set(ASKED)

    def _try(self) -> None:
        for name in self._open:
            if self._clients[name].service_is_ready():
                question = GetParameters.Request(names=list(ASKED[name]))
                self._clients[name].call_async(question).add_done_callback(partial(self._on_answer, name))

    def _on_answer(self, name: str, answer: Future) -> None:
        response: Any = answer.result()
        values = dict(zip(ASKED[name], response.values, strict=True)) if response else {}
        if not values or any(value.type != ParameterType.PARAMETER_DOUBLE for value in values.values()):
            return
        self._open.discard(name)
        self._values |= {each: value.double_value for each, value in values.items()}
        if self._values.keys() == {name for names in ASKED.values() for name in names}:
            self.known = Limits(**self._values)
