"""Serves the page on this machine alone, with what all browsers see of a walk, and takes what they ask for.

A browser gets text (JSON, see `broadcast`) and bytes (rows of float32). It sends JSON, which is input from outside:
only from a page of this very server, only so long, and checked before anything is done.
"""

import asyncio
import contextlib
import json
from collections.abc import AsyncIterator, Callable
from http import HTTPStatus
from typing import Any

from websockets.asyncio.server import Server, ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from rabbit_viewer.page.broadcast import Broadcast
from rabbit_viewer.page.files import SOCKET, find_file

HOST = "127.0.0.1"
LONGEST_MESSAGE = 4096  # bytes, from a browser
MOST_BROWSERS = 32
SEND_SECONDS = 0.02  # between two messages to a browser, at least
SAFE = {  # the page can reach nothing else, and nobody can put it into another page
    "Content-Security-Policy": "default-src 'self' data:; script-src 'self' 'unsafe-inline'; style-src 'self' "
    "'unsafe-inline'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cache-Control": "no-cache",
}

Answer = Callable[[str], str]  # of a message: empty, or one line that says why it is refused


class PageError(RuntimeError):
    """The page cannot be served; one line that says why."""


class PageServer:
    """The page of one `Broadcast`; `answer` is called with each message of a browser."""

    def __init__(self, broadcast: Broadcast, answer: Answer) -> None:
        self._broadcast, self._answer = broadcast, answer
        self._hosts: set[str] = set()
        self._server: Server

    @contextlib.asynccontextmanager
    async def serving(self, port: int) -> AsyncIterator[str]:
        """Serve at `port`, 0: any free one; gives the page's address.

        Raises:
            PageError: the port is taken.
        """
        try:
            self._server = await serve(
                self._on_browser,
                HOST,
                port,
                process_request=self._on_request,
                compression=None,
                max_size=LONGEST_MESSAGE,
                server_header=None,
            )
        except OSError as error:
            reason = error.strerror or error
            raise PageError(f"--port {port}: {reason}; expected a free port, or 0 for any") from error
        port = self._server.sockets[0].getsockname()[1]
        self._hosts = {f"{name}:{port}" for name in (HOST, "localhost")}
        try:
            yield f"http://{HOST}:{port}"
        finally:
            self._server.close(close_connections=True)
            await self._server.wait_closed()

    def _on_request(self, connection: ServerConnection, request: Request) -> Response | None:
        """A file of the page; None for the websocket. Another host's name in it means another site's page."""
        host, origin = request.headers.get("Host", ""), request.headers.get("Origin")
        if host not in self._hosts or origin not in (None, *(f"http://{name}" for name in self._hosts)):
            return connection.respond(HTTPStatus.FORBIDDEN, "this page is for browsers on this machine\n")
        path = request.path.partition("?")[0]
        if path == SOCKET:
            full = len(self._server.connections) > MOST_BROWSERS
            return connection.respond(HTTPStatus.SERVICE_UNAVAILABLE, "too many browsers\n") if full else None
        found = find_file(path)
        if found is None:
            return connection.respond(HTTPStatus.NOT_FOUND, "no such file\n")
        kind, body = found
        length = str(len(body))
        headers = Headers({"Content-Type": kind, "Content-Length": length, "Connection": "close", **SAFE})
        return Response(HTTPStatus.OK, "OK", headers, body)

    async def _on_browser(self, connection: ServerConnection) -> None:
        show = asyncio.create_task(self._show(connection))
        try:
            async for message in connection:
                refusal = self._answer(message) if isinstance(message, str) else "bytes: expected JSON"
                if refusal:
                    await connection.send(json.dumps({"type": "refused", "text": refusal}))
        except ConnectionClosed:
            pass
        finally:
            show.cancel()
            with contextlib.suppress(asyncio.CancelledError, ConnectionClosed):
                await show

    async def _show(self, connection: ServerConnection) -> None:
        async with contextlib.aclosing(self._broadcast.follow()) as words:
            async for word in words:
                await connection.send(word)
                if isinstance(word, bytes):
                    await asyncio.sleep(SEND_SECONDS)


def refused(text: Any) -> str:
    """On one line, not longer than a line."""
    line = " ".join(str(text).split())
    return line if len(line) <= 300 else f"{line[:297]}..."
