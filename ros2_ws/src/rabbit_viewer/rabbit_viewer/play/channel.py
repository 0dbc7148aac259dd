"""Messages between the server and a process that it started, each with its length in front, over a pair of sockets.

The server never waits: it reads what comes when it comes, and what it sends is kept in its memory until the process
takes it. So a process may wait for the server, and neither can block the other for good.
"""

import asyncio
import multiprocessing
import signal
import socket
import struct
import sys
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager, suppress
from multiprocessing.connection import Connection
from typing import Any

LENGTH = struct.Struct("!i")  # as the process's end has it, a `Connection` of the standard library
MOST_KEPT = 65_536  # bytes for a process that does not take them
ENDING_SECONDS = 0.7  # for a process to close what it has opened


class ServerChannel:
    """The server's end."""

    def __init__(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._reader, self._writer = reader, writer

    @property
    def is_full(self) -> bool:
        """The process does not take its messages: send only what must not be lost."""
        return self._writer.transport.get_write_buffer_size() > MOST_KEPT

    def send(self, message: bytes) -> None:
        """Send it as soon as the process takes it; does not wait."""
        self._writer.write(LENGTH.pack(len(message)) + message)

    async def hear(self, take: Callable[[bytes], object], end: Callable[[], object]) -> None:
        """Call `take` with each message, and `end` once there will be no more."""
        try:
            while True:
                (length,) = LENGTH.unpack(await self._reader.readexactly(LENGTH.size))
                take(await self._reader.readexactly(length))
        except (asyncio.IncompleteReadError, ConnectionError):
            pass
        finally:
            end()


@asynccontextmanager
async def process(
    target: Callable[..., None], *arguments: Any, take: Callable[[bytes], object], end: Callable[[], object]
) -> AsyncIterator[ServerChannel]:
    """A process that calls `target(channel, *arguments)`; ends it on leaving, at the latest after `ENDING_SECONDS`.

    `take` is called with each of its messages, `end` when it has ended.
    """
    here, there = socket.socketpair()
    reader, writer = await asyncio.open_connection(sock=here)
    channel = ServerChannel(reader, writer)
    with Connection(there.detach()) as end_there:
        words = (target, end_there, *arguments)
        started = multiprocessing.get_context("spawn").Process(target=until_ended, args=words, daemon=True)
        started.start()
    hearing = asyncio.create_task(channel.hear(take, end))
    try:
        yield channel
    finally:
        started.terminate()
        await asyncio.wait([hearing], timeout=ENDING_SECONDS)
        started.kill()  # the target has returned; all that is left is Python's own end
        started.join()
        writer.transport.abort()
        await hearing


def until_ended(target: Callable[..., None], end: Connection, *arguments: Any) -> None:
    """A process ends with the server or at SIGTERM, and closes what it opened; Ctrl-C is for the server."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, lambda *_: sys.exit())
    with end, suppress(EOFError, ConnectionError):
        target(end, *arguments)
