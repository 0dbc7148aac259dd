"""A client of the live view without a browser: what the tests look through.

The protocol is Foxglove's: the server advertises channels in JSON; a subscribed channel's messages come as bytes:
opcode 1, subscription (uint32), time (uint64, ns), then the message in the channel's encoding.
"""

import json
import struct
import time
from contextlib import ExitStack
from typing import Any, NamedTuple, Self

from websockets.exceptions import WebSocketException
from websockets.sync.client import ClientConnection, connect
from websockets.typing import Subprotocol

PROTOCOL = Subprotocol("foxglove.sdk.v1")
DATA = struct.Struct("<BIQ")
MESSAGE = 1
TRY_SECONDS = 0.02


class Channel(NamedTuple):
    """What the server advertises: schema and encoding of a topic."""

    topic: str
    encoding: str
    schema_name: str
    schema: str


class Message(NamedTuple):
    """One message as it came, and the simulated time that it carries."""

    topic: str
    nanoseconds: int
    data: bytes


class Listener:
    """Hears all topics of a live view; a context manager, which connects as soon as somebody serves."""

    def __init__(self, address: str, timeout: float = 5.0) -> None:
        self._address, self._timeout = address, timeout
        self._stack = ExitStack()
        self._connection: ClientConnection
        self.channels: dict[int, Channel] = {}
        self.has_ended = False

    def __enter__(self) -> Self:
        """Raises: `TimeoutError` if nobody serves within `timeout` s."""
        end = time.monotonic() + self._timeout
        while True:
            try:
                asked = connect(self._address, subprotocols=[PROTOCOL], compression=None, max_size=None)
                self._connection = self._stack.enter_context(asked)
                return self
            except OSError as error:
                if time.monotonic() > end:
                    raise TimeoutError(f"nobody serves at {self._address}") from error
                time.sleep(TRY_SECONDS)

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    def hear(self, timeout: float) -> Message | None:
        """The next message; None if there is none within `timeout` s, or the view has ended."""
        end = time.monotonic() + timeout
        while (left := end - time.monotonic()) > 0:
            try:
                got = self._connection.recv(timeout=left)
            except TimeoutError:
                return None
            except WebSocketException:
                self.has_ended = True
                return None
            if isinstance(got, str):
                self._take(json.loads(got))
            elif got[0] == MESSAGE:
                _, number, nanoseconds = DATA.unpack_from(got)
                return Message(self.channels[number].topic, nanoseconds, got[DATA.size :])
        return None

    def _take(self, got: dict[str, Any]) -> None:
        """Subscribe to what is advertised, each channel under its own number."""
        if got["op"] != "advertise":
            return
        new = {c["id"]: Channel(c["topic"], c["encoding"], c["schemaName"], c["schema"]) for c in got["channels"]}
        self.channels |= new
        subscriptions = [{"id": number, "channelId": number} for number in new]
        self._connection.send(json.dumps({"op": "subscribe", "subscriptions": subscriptions}))
