"""A page that is served from a thread of its own, for an owner who has other things to do."""

import asyncio
import threading
from collections.abc import Callable
from typing import Any

from rabbit_viewer.page.address import HOST
from rabbit_viewer.page.broadcast import Broadcast
from rabbit_viewer.page.server import Answer, PageServer


class BackgroundPage:
    """`address`: of the page. Its `broadcast` is the thread's: use `do`."""

    def __init__(self, port: int, answer: Answer, host: str = HOST) -> None:
        """Raises `PageError`; `answer` is called in the thread."""
        self.broadcast = Broadcast()
        self.address = ""
        self._loop = asyncio.new_event_loop()
        self._end = asyncio.Event()
        self._error: Exception | None = None
        ready = threading.Event()
        self._thread = threading.Thread(target=self._run, args=(port, answer, host, ready), daemon=True)
        self._thread.start()
        ready.wait()
        if self._error:
            raise self._error

    @property
    def is_watched(self) -> bool:
        """Some browser is there."""
        return self.broadcast.followers > 0

    def do(self, what: Callable[..., object], *arguments: Any) -> None:
        """Call a method of the broadcast soon, in the thread."""
        self._loop.call_soon_threadsafe(what, *arguments)

    def close(self) -> None:
        """Serve no more, once all that was to be done is done."""
        self.do(self._end.set)
        self._thread.join()

    def _run(self, port: int, answer: Answer, host: str, ready: threading.Event) -> None:
        self._loop.run_until_complete(self._serve(port, answer, host, ready))

    async def _serve(self, port: int, answer: Answer, host: str, ready: threading.Event) -> None:
        try:
            async with PageServer(self.broadcast, answer).serving(port, host) as self.address:
                ready.set()
                await self._end.wait()
        except Exception as error:  # for the owner, who waits
            self._error = error
            ready.set()
