"""Serves the page on this machine alone, with what all browsers see of a walk, and takes what they ask for.

A browser gets text (JSON, see `broadcast`) and bytes (rows of float32). It sends JSON, which is input from outside:
only from a page of this very server, only so long, and checked before anything is done.
"""

import asyncio
import contextlib
import json
import logging
import os
import sys
import threading
import time
import webbrowser
from collections.abc import Callable
from http import HTTPStatus
from typing import Any
from weakref import WeakSet

from rabbit_common.guard import guarded
from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from rabbit_viewer.page import HOST, NAMES, PageError
from rabbit_viewer.page.broadcast import Broadcast
from rabbit_viewer.page.files import KINDS, SAVED, SOCKET, find_file, page_with

LONGEST_MESSAGE = 8192  # bytes, from a browser
MOST_BROWSERS = 32
MOST_MESSAGES = 50  # of a browser in a second
SEND_SECONDS = 0.02  # between two looks at what is new for a browser
CLOSING_SECONDS = 0.3  # for browsers to take leave
SAFE = {  # the page can reach nothing else, and nobody can put it into another page
    "Content-Security-Policy": "default-src 'self' data:; script-src 'self' 'unsafe-inline'; style-src 'self' "
    "'unsafe-inline'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
}

QUIET_SECONDS = 10.0  # after an error's line: a flood of connections must not flood the terminal

Answer = Callable[[str], str]  # of a message: empty, or one line that says why it is refused


class OneLine(logging.Handler):
    """Writes a record as one line to stderr, and for `QUIET_SECONDS` no other."""

    _quiet_until = 0.0

    def emit(self, record: logging.LogRecord) -> None:
        """Write a line, unless one was written just now."""
        now = time.monotonic()
        if now >= self._quiet_until:
            self._quiet_until = now + QUIET_SECONDS
            error = record.exc_info[1] if record.exc_info else None
            text = f"page: {record.getMessage()}{f': {error!r}' if error else ''}"
            print(" ".join(text.split()), file=sys.stderr, flush=True)


log = logging.getLogger(__name__)
log.addHandler(OneLine(logging.ERROR))
log.propagate = False


def log_error(_: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """Logs, for an event loop, an error that nobody waits for."""
    log.error(context["message"], exc_info=context.get("exception"))


class PageServer:
    """The page of a `Broadcast`, served from another thread. `address`: of the page."""

    def __init__(self, broadcast: Broadcast, answer: Answer, port: int, host: str = HOST) -> None:
        """`answer` is called in that thread with the messages of browsers; `port` 0: any free one.

        Raises:
            PageError: the port is taken, or `host` is no address of this machine.
        """
        self._broadcast, self._answer = broadcast, answer
        self._connections: WeakSet[ServerConnection] = WeakSet()  # those too that have asked for nothing yet
        self._loop = asyncio.new_event_loop()
        self._loop.set_exception_handler(log_error)
        self._thread = threading.Thread(target=self._loop.run_forever, daemon=True)
        self._thread.start()
        self._server: Server = asyncio.run_coroutine_threadsafe(self._serve(port, host), self._loop).result()
        self.address = f"http://{HOST}:{self._server.sockets[0].getsockname()[1]}"

    @property
    def is_watched(self) -> bool:
        """Some browser is there."""
        return self._broadcast.followers > 0

    def announce(self, opens_browser: bool) -> None:
        """Say where the page is."""
        print(f"open {self.address} in a browser; Ctrl-C ends", flush=True)
        if opens_browser:
            threading.Thread(target=webbrowser.open, args=(self.address,), daemon=True).start()

    def close(self) -> None:
        """Serve no more; nothing if that was said before."""
        if not self._thread.is_alive():
            return
        asyncio.run_coroutine_threadsafe(self._close(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()

    async def _serve(self, port: int, host: str) -> Server:
        try:
            return await serve(
                self._on_browser,
                host,
                port,
                process_request=self._on_request,
                create_connection=self._connection,  # type: ignore[arg-type]  # it is called, no more
                compression=None,
                max_size=LONGEST_MESSAGE,
                server_header=None,
                logger=log,
            )
        except (OSError, UnicodeError) as error:
            number = getattr(error, "errno", None) or 0
            reason = os.strerror(number) if number > 0 else getattr(error, "strerror", error)
            raise PageError(f"page at {host}:{port}: {reason}; expected this machine's address, a free port") from error

    async def _close(self) -> None:
        """Close the connections; one that has not closed within `CLOSING_SECONDS` is cut."""
        self._server.close()
        with contextlib.suppress(TimeoutError):
            await asyncio.wait_for(self._server.wait_closed(), CLOSING_SECONDS)
        for connection in self._connections:
            connection.transport.abort()
        await self._server.wait_closed()

    def _connection(self, *arguments: Any, **options: Any) -> ServerConnection:
        connection = ServerConnection(*arguments, **options)
        self._connections.add(connection)
        return connection

    def _on_request(self, connection: ServerConnection, request: Request) -> Response | None:
        """A file of the page; None for the websocket.

        A page of another site says so as the origin, or asks for a name that it has made this machine's.
        """
        host, origin = request.headers.get("Host", ""), request.headers.get("Origin")
        if host.rpartition(":")[0] not in NAMES or origin not in (None, f"http://{host}"):
            return connection.respond(HTTPStatus.FORBIDDEN, "this page is for browsers on this machine\n")
        path = request.path.partition("?")[0]
        if path == SOCKET:
            full = len(self._server.connections) > MOST_BROWSERS
            return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, "too many browsers\n") if full else None
        file = (KINDS["html"], page_with(self._broadcast).encode()) if path == SAVED else find_file(path)
        if file is None:
            return connection.respond(HTTPStatus.NOT_FOUND, "no such file\n")
        kind, body = file
        length = str(len(body))
        headers = Headers({"Content-Type": kind, "Content-Length": length, "Connection": "close", **SAFE})
        return Response(HTTPStatus.OK, "OK", headers, body)

    async def _on_browser(self, connection: ServerConnection) -> None:
        show = asyncio.create_task(self._show(connection))
        since, count = 0.0, 0
        try:
            async for message in connection:
                now = asyncio.get_running_loop().time()
                since, count = (since, count + 1) if now - since < 1 else (now, 1)
                if refusal := self._answered(message, count):
                    await connection.send(json.dumps({"type": "refused", "text": refusal}))
                await asyncio.sleep(0)  # let the others go on: messages that have come are read without a pause
        except ConnectionClosed:
            pass
        finally:
            show.cancel()
            with contextlib.suppress(asyncio.CancelledError, ConnectionClosed):
                await show

    def _answered(self, message: str | bytes, count: int) -> str:
        if count > MOST_MESSAGES:
            return f"more than {MOST_MESSAGES} messages in a second"
        if not isinstance(message, str):
            return "bytes: expected JSON"
        return guarded(self._answer, lambda reason, _: refused(reason))(message)

    async def _show(self, connection: ServerConnection) -> None:
        async with contextlib.aclosing(self._broadcast.follow()) as news:
            async for words in news:
                for word in words:
                    await connection.send(word)
                await asyncio.sleep(SEND_SECONDS)


def refused(text: Any) -> str:
    """The text on one line, not longer than a line."""
    line = " ".join(str(text).split())
    return line if len(line) <= 300 else f"{line[:297]}..."
