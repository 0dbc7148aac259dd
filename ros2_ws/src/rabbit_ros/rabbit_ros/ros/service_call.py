"""A question to a service, asked again while no answer comes.

A server may hear a request before it knows the asker's reader: its answer is then lost, and `wait_for_service` cannot
tell. So a service of this graph must bear being asked twice.
"""

import time
from collections.abc import Callable
from typing import Any

AGAIN_SECONDS = 3.0


def call_service(client: Any, request: Any, spin: Callable[[float], object], timeout: float) -> Any:
    """The service's answer, or None where none comes within `timeout` s. `spin(seconds)` lets the client hear."""
    end = time.monotonic() + timeout
    if not client.wait_for_service(timeout_sec=timeout):
        return None
    answers = []
    while (now := time.monotonic()) < end:
        answers.append(client.call_async(request))
        again = min(now + AGAIN_SECONDS, end)
        while time.monotonic() < again:
            spin(0.02)
            for answer in answers:
                if answer.done():
                    return answer.result()
    return None
