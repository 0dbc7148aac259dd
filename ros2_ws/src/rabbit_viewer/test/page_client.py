"""A client of the page without a browser: what the tests hear of a walk, and say."""

import json
import socket
import struct
import time
from contextlib import ExitStack
from typing import Any, Self

from websockets.exceptions import WebSocketException
from websockets.sync.client import ClientConnection, connect

TRY_SECONDS = 0.02


def free_port() -> int:
    """One that was free a moment ago."""
    with socket.socket() as one:
        one.bind(("127.0.0.1", 0))
        return int(one.getsockname()[1])


class PageClient:
    """Connects as soon as somebody serves; a context manager.

    `words`: the newest of each kind. `rows`: of the present episode, a dictionary by column for each walker.
    """

    def __init__(self, address: str, timeout: float = 180.0, watches: bool = True, **headers: str) -> None:
        """`watches`: it says so, as a page does that is seen, and a played walk begins."""
        self._address, self._timeout, self._headers = address.replace("http", "ws", 1) + "/walk", timeout, headers
        self._stack, self._watches = ExitStack(), watches
        self._connection: ClientConnection
        self.words: dict[str, dict[str, Any]] = {}
        self.said: list[dict[str, Any]] = []
        self.rows: list[list[dict[str, float]]] = []
        self.has_ended = False

    def __enter__(self) -> Self:
        """Raises: `TimeoutError` if nobody serves within `timeout` s."""
        end = time.monotonic() + self._timeout
        while True:
            try:
                asked = connect(self._address, compression=None, max_size=None, additional_headers=self._headers)
                self._connection = self._stack.enter_context(asked)
                if self._watches:
                    self.say({"do": "watch"})
                return self
            except OSError as error:
                if time.monotonic() > end:
                    raise TimeoutError(f"nobody serves at {self._address}") from error
                time.sleep(TRY_SECONDS)

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def say(self, message: Any) -> None:
        """Send text or bytes as they are, anything else as JSON."""
        self._connection.send(message if isinstance(message, str | bytes) else json.dumps(message))

    def hear(self, timeout: float = 0.2) -> bool:
        """Take the next message; False if there is none within `timeout` s, or the server has ended."""
        try:
            got = self._connection.recv(timeout=timeout)
        except TimeoutError:
            return False
        except WebSocketException:
            self.has_ended = True
            return False
        if isinstance(got, bytes):
            self._take(got)
            return True
        word = json.loads(got)
        self.words[word["type"]] = word
        self.said.append(word)
        if word["type"] == "about":
            self.rows = []
        return True

    def wait(self, is_done: Any) -> None:
        """Hear until `is_done(self)`; raises `TimeoutError`."""
        end = time.monotonic() + self._timeout
        while not is_done(self):
            self.hear()
            if self.has_ended or time.monotonic() > end:
                raise TimeoutError(f"heard {list(self.words)} and {len(self.rows)} rows")

    def _take(self, data: bytes) -> None:
        numbers = iter(struct.unpack(f"<{len(data) // 4}f", data))
        columns = [walker["columns"] for walker in self.words["about"]["walkers"]]
        for first in numbers:
            row = iter([first, *(next(numbers) for _ in range(sum(map(len, columns)) - 1))])
            self.rows.append([{name: next(row) for name in names} for names in columns])
