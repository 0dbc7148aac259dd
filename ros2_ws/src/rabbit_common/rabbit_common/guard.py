"""What a callback, a service or a job of a thread raises becomes a refusal with its reason, and the next one is served.

Without it one message that nobody thought of ends a node, or the thread that takes such messages.
"""

import traceback
from collections.abc import Callable
from functools import wraps
from pathlib import Path
from typing import Concatenate, ParamSpec, TypeVar

from rabbit_description.validation import one_line

P = ParamSpec("P")
T = TypeVar("T")


def guarded(call: Callable[P, T], refuse: Callable[Concatenate[str, P], T]) -> Callable[P, T]:
    """`call`; where it raises, `refuse(reason, *arguments)` with the reason in one line."""

    @wraps(call)
    def safe(*arguments: P.args, **named: P.kwargs) -> T:
        try:
            return call(*arguments, **named)
        except KeyboardInterrupt:
            raise
        except BaseException as error:  # a panic of a library in Rust is no `Exception`, nor is a user's `sys.exit()`
            return refuse(reason_of(error), *arguments, **named)

    return safe


def reason_of(error: BaseException) -> str:
    """What an error says, in one line; its type and place too where it is no `ValueError`, as ours are."""
    said = one_line(error)
    if isinstance(error, ValueError) and said:
        return said
    frames = traceback.extract_tb(error.__traceback__)
    place = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}: {said}{place}"
