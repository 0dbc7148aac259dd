"""Services both ways: one whose answer takes time, and a call that is put again while no answer comes."""

import time
from collections.abc import Callable
from typing import Any

from rcl_interfaces.msg import SetParametersResult
from rcl_interfaces.srv import SetParameters, SetParametersAtomically
from rclpy.node import Node
from rclpy.service import Service
from rclpy.task import Future

from rabbit_common.guard import guarded

AGAIN_SECONDS = 3.0


def guard_services(node: Node) -> None:
    """Have all services of a node, rclpy's own too, answer whatever comes: a request that raises is refused."""
    for service in node.services:
        service.callback = guarded(service.callback, _refusal)


def _refusal(reason: str, request: Any, response: Any) -> Any:
    """The answer that says why; nothing but an answer where its type has no place for that."""
    failed = SetParametersResult(successful=False, reason=reason)
    match response:
        case SetParameters.Response():
            response.results += [failed] * (len(request.parameters) - len(response.results))
        case SetParametersAtomically.Response():
            response.result = failed
        case _ if hasattr(response, "success"):
            response.success, response.message = False, reason
    return response


def create_async_service(node: Node, kind: Any, name: str, callback: Callable[[Any, Any], Future]) -> Service:
    """A service whose `callback(request, response)` returns a future of the answer; the node goes on meanwhile.

    A future made with the node's executor may be completed in any thread; the answer goes out in the executor's. That
    executor runs no coroutines as callbacks; what a callback returns goes to `Service.send_response`.
    """
    service = node.create_service(kind, name, callback)
    send = service.send_response

    def send_when_done(answer: Future, header: Any) -> None:
        answer.add_done_callback(lambda done: send(done.result(), header))

    service.send_response = send_when_done  # type: ignore[method-assign, assignment]
    return service


def call_service(
    client: Any, request: Any, spin: Callable[[float], object], timeout: float, again: float = AGAIN_SECONDS
) -> Any:
    """The service's answer, or None where none comes within `timeout` s. `spin(seconds)` lets the client hear.

    After `again` s without an answer the service is asked once more.
    A server may hear a request before it knows the asker's reader: its answer is then lost, and `wait_for_service`
    cannot tell. So a service of this graph must bear being asked twice.
    """
    end = time.monotonic() + timeout
    if not client.wait_for_service(timeout_sec=timeout):
        return None
    answers = []
    while (now := time.monotonic()) < end:
        answers.append(client.call_async(request))
        pause = min(now + again, end)
        while time.monotonic() < pause:
            spin(0.02)
            for answer in answers:
                if answer.done():
                    return answer.result()
    return None
