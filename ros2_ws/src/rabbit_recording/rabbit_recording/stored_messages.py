"""A recording's messages in the order of time, each with the run of the simulator that it belongs to.

A simulator without a memory that is started again counts episodes and ticks from the start: another run. It announces
itself by waiting for episode 0. The same announcement comes to a recorder that is started later, as history: there the
states go on where they were.
"""

import contextlib
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from rabbit_description.state import TICK_NANOSECONDS
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection

from rabbit_recording import RecordingError
from rabbit_recording.former_messages import is_former, parts, renewed, renewed_bytes
from rabbit_recording.message_header import FIELDS, episode_and_phase_of, nanoseconds_of, turn_of
from rabbit_recording.open_recording import last_name, one_line_errors, opened

OWN_TYPES = "rabbit_msgs/"
ANNOUNCED = ("episode", "preview", "landing")  # by the simulator, and latched
FIRST_WORD = (0, 0)  # episode and phase with which a simulator begins: none, and WAITING in rabbit_msgs/Episode


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

    @property
    def zero(self) -> int:
        """Where its simulated time counts from, ns."""
        return self.at - self.stamp


@contextlib.contextmanager
def stored_messages(path: Path, *names: str) -> Iterator[Iterator[StoredMessage]]:
    """Messages of this project's own types in the order of time, all if no `names`; to be decoded while it is open.

    Those of a former recording come as today's. Raises `RecordingError`: no recording, one that cannot be read, a topic
    that is in it from several graphs, or messages that are defined otherwise than this version's.
    """
    with opened(path) as reader:
        ours = [c for c in reader.connections if c.msgtype.startswith(OWN_TYPES)]
        chosen = [c for c in ours if not names or set(parts(last_name(c.topic))) & set(names)]
        topics = sorted({c.topic for c in chosen})
        several = [topic for topic in topics if [*map(last_name, topics)].count(last_name(topic)) > 1]
        if several:
            raise RecordingError(f"recording {path}: of several graphs: {', '.join(several)}")
        for connection in chosen:
            _check_fields(path, reader, connection)
        each = _each(reader, chosen, path)
        yield (message for message in each if not names or message.topic in names)


def _check_fields(path: Path, reader: AnyReader, connection: Connection) -> None:
    expected = FIELDS.get(last_name(connection.topic), ())
    with one_line_errors(path):
        names = tuple(name for name, _ in reader.typestore.fielddefs[connection.msgtype][1])
        begin = int(is_former(reader, connection.msgtype))
    if names[begin : len(expected)] != expected[begin:]:
        here = f"{connection.msgtype} begins with {', '.join(names)}; expected {', '.join(expected)}"
        raise RecordingError(f"recording {path}: recorded under other message definitions: {here}")


def _each(reader: AnyReader, connections: list[Connection], path: Path) -> Iterator[StoredMessage]:
    with one_line_errors(path):
        former = {c.msgtype for c in connections if is_former(reader, c.msgtype)}
        for connection, at, data in reader.messages(connections) if connections else ():
            name, decode = last_name(connection.topic), partial(reader.deserialize, data, connection.msgtype)
            if connection.msgtype in former:
                data, again = renewed_bytes(data), partial(renewed, decode)
                yield from (StoredMessage(each, at, data, again) for each in parts(name))
            else:
                yield StoredMessage(name, at, data, decode)


def by_run(messages: Iterable[StoredMessage]) -> Iterator[tuple[int, StoredMessage]]:
    """Before each message the simulator's run that it belongs to, from 0; `state` and `episode` must be among them.

    A first word begins a run if the next state's time counts from it and does not go on where the one before was.
    What a simulator announced belongs to the run from whose beginning its time counts, however late it came.
    """
    run = 0
    announced: int | None = None  # where the newest announcement's time counts from
    began: dict[int, int] = {}  # where a run's time counts from: the run
    newest: StoredMessage | None = None  # state
    held: list[StoredMessage] = []  # from a first word on, until a state says whose it was
    for message in messages:
        is_state, is_episode = message.topic == "state", message.topic == "episode"
        is_first_word = is_episode and episode_and_phase_of(message.data) == FIRST_WORD
        if held and is_state and newest is not None:
            run += message.zero == held[0].zero and not _goes_on(newest, message)
            yield from ((run, each) for each in held)
            held = []
        if held or (newest is not None and is_first_word):
            held.append(message)
            continue
        newest = message if is_state else newest
        run += is_first_word and announced not in (None, message.zero)
        announced = message.zero if is_episode else announced
        if is_state or is_episode:
            began.setdefault(message.zero, run)
        yield (began.get(message.zero, run) if message.topic in ANNOUNCED else run), message
    if held and newest is not None and all(each.stamp < newest.stamp for each in held if each.topic == "episode"):
        run += 1
    yield from ((run, each) for each in held)


def _goes_on(newest: StoredMessage, state: StoredMessage) -> bool:
    """Whether a state is the one after the newest: a tick later, or another episode's at the same time."""
    ahead = state.stamp - newest.stamp
    return ahead == TICK_NANOSECONDS or (ahead == 0 and state.turn != newest.turn)
