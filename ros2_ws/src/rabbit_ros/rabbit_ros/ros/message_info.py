"""A subscription's callback with the middleware's information on each message, under any executor.

rclpy reads from a callback's signature whether it wants the information. Its EventsExecutor then hands over both as one
tuple, the other executors as two arguments.
"""

import inspect
from collections.abc import Callable
from typing import Any

NUMBER = "publication_sequence_number"  # how many messages its publisher had sent with this one
SENT = "source_timestamp"  # when, ns of the wall clock

_TWO = [inspect.Parameter(name, inspect.Parameter.POSITIONAL_ONLY) for name in ("message", "info")]


def with_info(callback: Callable[[Any, dict[str, Any]], None]) -> Callable[..., None]:
    """Have rclpy call `callback(message, info)`."""

    def take(*got: Any) -> None:
        message, info = got if len(got) == len(_TWO) else got[0]
        callback(message, info)

    take.__signature__ = inspect.Signature(_TWO)  # type: ignore[attr-defined]
    return take
