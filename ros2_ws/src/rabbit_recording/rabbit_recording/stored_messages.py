"""A recording's messages in the order of time."""

import contextlib
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection

from rabbit_recording import RecordingError
from rabbit_recording.message_header import FIELDS, nanoseconds_of, turn_of
from rabbit_recording.open_recording import last_name, one_line_errors, opened

OUR_TYPES = "rabbit_msgs/"


class StoredMessage(NamedTuple):
    """A message: the last part of its topic, when it is stored (ns), its bytes, and what decodes them."""

    topic: str
    at: int
    data: bytes
    decode: Callable[[], Any]

    @property
    def turn(self) -> tuple[int, int]:
        """Episode by the simulator's count, and tick, of messages that have both."""
        return turn_of(self.data)

    @property
    def stamp(self) -> int:
        """Simulated time, ns."""
        return nanoseconds_of(self.data)


@contextlib.contextmanager
def stored_messages(path: Path, *names: str) -> Iterator[Iterator[StoredMessage]]:
    """Messages of this project's own types in the order of time, all if no `names`; to be decoded while it is open.

    Raises `RecordingError`: no recording, one that cannot be read, a topic that is in it from several graphs, or
    messages that are defined otherwise than this version's.
    """
    with opened(path) as reader:
        ours = [c for c in reader.connections if c.msgtype.startswith(OUR_TYPES)]
        chosen = [c for c in ours if not names or last_name(c.topic) in names]
        topics = sorted({c.topic for c in chosen})
        several = [topic for topic in topics if [*map(last_name, topics)].count(last_name(topic)) > 1]
        if several:
            raise RecordingError(f"recording {path}: of several graphs: {', '.join(several)}")
        for connection in chosen:
            _check_fields(path, reader, connection)
        yield _messages_of(reader, chosen, path)


def _check_fields(path: Path, reader: AnyReader, connection: Connection) -> None:
    expected = FIELDS.get(last_name(connection.topic), ())
    with one_line_errors(path):
        names = tuple(name for name, _ in reader.typestore.fielddefs[connection.msgtype][1])
    if names[: len(expected)] != expected:
        here = f"{connection.msgtype} begins with {', '.join(names)}; expected {', '.join(expected)}"
        raise RecordingError(f"recording {path}: recorded under other message definitions: {here}")


def _messages_of(reader: AnyReader, connections: list[Connection], path: Path) -> Iterator[StoredMessage]:
    with one_line_errors(path):
        for connection, at, data in reader.messages(connections) if connections else ():
            decode = partial(reader.deserialize, data, connection.msgtype)
            yield StoredMessage(last_name(connection.topic), at, data, decode)
