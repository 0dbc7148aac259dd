"""Errors while a page is served, as one line, and rarely: a flood of connections must not flood the terminal."""

import asyncio
import logging
import sys
import time
from typing import Any

QUIET_SECONDS = 10.0  # after a line


class OneLine(logging.Handler):
    """Writes a record as one line to stderr, and for `QUIET_SECONDS` no other."""

    def __init__(self) -> None:
        super().__init__(logging.ERROR)
        self._quiet_until = -QUIET_SECONDS

    def emit(self, record: logging.LogRecord) -> None:
        """Write a line, unless one was written just now."""
        now = time.monotonic()
        if now >= self._quiet_until:
            self._quiet_until = now + QUIET_SECONDS
            error = record.exc_info[1] if record.exc_info else None
            text = f"page: {record.getMessage()}{f': {error!r}' if error else ''}"
            print(" ".join(text.split()), file=sys.stderr, flush=True)


log = logging.getLogger(__name__)
log.addHandler(OneLine())
log.propagate = False


def log_error(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """For an event loop: an error that nobody waits for."""
    log.error(context["message"], exc_info=context.get("exception"))
