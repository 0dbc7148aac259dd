"""A service whose answer takes time: it is sent when it is there, and the node goes on meanwhile.

The executor of these nodes runs no coroutines as callbacks; what a callback returns goes to `Service.send_response`.
"""

from collections.abc import Callable
from typing import Any

from rclpy.node import Node
from rclpy.service import Service
from rclpy.task import Future


def create_async_service(node: Node, kind: Any, name: str, callback: Callable[[Any, Any], Future]) -> Service:
    """A service whose `callback(request, response)` returns a future of the answer.

    A future made with the node's executor may be completed in any thread; the answer goes out in the executor's.
    """
    service = node.create_service(kind, name, callback)
    send = service.send_response

    def send_when_done(answer: Future, header: Any) -> None:
        answer.add_done_callback(lambda done: send(done.result(), header))

    service.send_response = send_when_done  # type: ignore[method-assign, assignment]
    return service
