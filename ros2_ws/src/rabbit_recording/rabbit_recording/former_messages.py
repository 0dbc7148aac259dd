"""Messages of former recordings as those of today.

Their definitions are in the recordings. Before messages had a `std_msgs/Header`, they began with a bare stamp, arrays
had RABBIT's lengths, and a `ControllerState` also held what is now in `LearnerTerms`. Fields that came later get what
their absence meant.
"""

from collections.abc import Callable
from dataclasses import fields
from types import SimpleNamespace
from typing import Any

import numpy as np
from rabbit_description.state import LAYOUT, TICK_SECONDS
from rl_cbf_clf_controller.message_fields import STONE_BARRIERS, bounded_fields
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.typesys.store import Typestore

NEW_KINDS = {"rabbit_msgs/msg/RabbitState": "rabbit_msgs/msg/RobotState"}
EPISODE = "rabbit_msgs/msg/Episode"
STAMP = "stamp"  # first field of a former message
EMPTY_FRAME = b"\1\0\0\0" + bytes(4)  # a header's end: no name, padded so that what follows stays aligned
OLDER = {  # fields that older messages have not
    **{"sender": "", "controller": "", "refused_controller": "", "height": 0.0},
    "tick_seconds": TICK_SECONDS,
}


def is_former(reader: AnyReader, kind: str) -> bool:
    """Whether a type of the recording is of a former version."""
    return kind.startswith("rabbit_msgs/") and [name for name, _ in reader.typestore.fielddefs[kind][1]][:1] == [STAMP]


def is_of_version_0_1(reader: AnyReader) -> bool:
    """Whether the recording was made before an episode said how long a tick lasts."""
    fields_of = reader.typestore.fielddefs
    return EPISODE in fields_of and "tick_seconds" not in dict(fields_of[EPISODE][1])


def lacks_fields(reader: AnyReader, kind: str, today: Typestore) -> bool:
    """Whether a type of the recording is today's but for some of `OLDER`."""
    if kind not in today.fielddefs:
        return False
    then, now = ({name for name, _ in store.fielddefs[kind][1]} for store in (reader.typestore, today))
    return then < now and now - then <= OLDER.keys()


def parts(name: str) -> tuple[str, ...]:
    """The topics of today in which a former message's fields are, by the last part of its topic."""
    return ("controller_state", "learner_terms") if name == "controller_state" else (name,)


def renewed_bytes(data: bytes) -> bytes:
    """The bytes with a header instead of the stamp, so that `message_header` can read them."""
    return data[:12] + EMPTY_FRAME + data[12:]


def renewed(decode: Callable[[], Any]) -> Any:
    """A message with the fields of today's; of a `ControllerState`, also those of `LearnerTerms`."""
    now = {**OLDER, **vars(decode())}
    if STAMP in now:
        now["header"] = SimpleNamespace(stamp=now.pop(STAMP), frame_id="world")
    if "outcome" in now:
        now = {name: list(names) for name, names in LAYOUT.items()} | now
    if "clf" in now:
        V, barriers, rates = (now.pop(name) for name in ("clf", "barriers", "barrier_rates"))
        names = STONE_BARRIERS if np.isfinite(barriers).all() else ()  # else the ground was flat
        now |= bounded_fields(V, names, barriers[: len(names)], rates[: len(names)])
        now |= {"rows": [], **dict.fromkeys(("margins", "slacks", "multipliers"), np.zeros(0))}
        now.setdefault("measured", np.full(len(now["quantities"]), np.nan))
    return SimpleNamespace(**now)


class Renewal:
    """Bytes of a recording into those of today, of its own types; what is of today stays. `former`: the types."""

    def __init__(self, reader: AnyReader, today: Typestore) -> None:
        self._reader, self._today = reader, today
        kinds = {c.msgtype for c in reader.connections}
        self.former = {kind for kind in kinds if is_former(reader, kind) or lacks_fields(reader, kind, today)}

    def topics(self, connection: Connection) -> dict[str, str]:
        """The types of the topics, by full name, that a recorded one is of."""
        topic, kind = connection.topic, connection.msgtype
        if kind not in self.former:
            return {topic: kind}
        place, _, name = topic.rpartition("/")
        kinds = {"learner_terms": "rabbit_msgs/msg/LearnerTerms"}
        return {f"{place}/{part}": kinds.get(part, NEW_KINDS.get(kind, kind)) for part in parts(name)}

    def messages(self, connection: Connection, data: bytes) -> dict[str, bytes]:
        """By topic, what a recorded one is."""
        if connection.msgtype not in self.former:
            return {connection.topic: data}
        message = renewed(lambda: self._reader.deserialize(data, connection.msgtype))
        return {topic: self._bytes(kind, message) for topic, kind in self.topics(connection).items()}

    def _bytes(self, kind: str, message: Any) -> bytes:
        types: dict[str, Any] = {**self._today.types}
        at = message.header.stamp
        stamp = types["builtin_interfaces/msg/Time"](sec=at.sec, nanosec=at.nanosec)
        header = types["std_msgs/msg/Header"](stamp=stamp, frame_id=message.header.frame_id)
        values = {each.name: getattr(message, each.name) for each in fields(types[kind])}
        return bytes(self._today.serialize_cdr(types[kind](**{**values, "header": header}), kind))
