"""A page that is served from a thread of its own, for an owner who has other things to do."""

import asyncio
import threading
from collections.abc import Callable
from contextlib import AsyncExitStack
from typing import Any

from rabbit_viewer.page.address import HOST
from rabbit_viewer.page.broadcast import Broadcast
from rabbit_viewer.page.server import Answer, PageServer


class BackgroundPage:
    """`address`: of the page. Its `broadcast` is the thread's: use `do`."""

    def __init__(self, port: int, answer: Answer, host: str = HOST) -> None:
        """Raises `PageError`; `answer` is called in the thread."""
        self.broadcast = Broadcast()
        self._loop, self._page = asyncio.new_event_loop(), AsyncExitStack()
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        serving = self._page.enter_async_context(PageServer(self.broadcast, answer).serving(port, host))
        self.address = asyncio.run_coroutine_threadsafe(serving, self._loop).result()

    @property
    def is_watched(self) -> bool:
        """Some browser is there."""
        return self.broadcast.followers > 0

    def do(self, what: Callable[..., object], *arguments: Any) -> None:
        """Call a method of the broadcast soon, in the thread."""
        self._loop.call_soon_threadsafe(what, *arguments)

    def close(self) -> None:
        """Serve no more, once all that was to be done is done."""
        asyncio.run_coroutine_threadsafe(self._page.aclose(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
