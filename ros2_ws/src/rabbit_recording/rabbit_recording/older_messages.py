"""Messages of older recordings as those of today: fields that came later get what their absence meant."""

from dataclasses import fields
from typing import Any

from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.typesys.store import Typestore

LATER = {"sender": ""}  # fields that older messages have not


class Renewal:
    """Bytes of a recording into those of today; what is of today stays. `older`: the types that lack fields."""

    def __init__(self, reader: AnyReader, today: Typestore) -> None:
        self._reader, self._today = reader, today
        self.older = {each.msgtype for each in reader.connections if self._is_older(each.msgtype)}

    def _is_older(self, kind: str) -> bool:
        """Whether the type is today's but for some of `LATER`."""
        if kind not in self._today.fielddefs:
            return False
        then, now = ({name for name, _ in store.fielddefs[kind][1]} for store in (self._reader.typestore, self._today))
        return then < now and now - then <= LATER.keys()

    def message(self, connection: Connection, data: bytes) -> bytes:
        """What a recorded one is today."""
        kind, types = connection.msgtype, dict[str, Any](self._today.types)
        if kind not in self.older:
            return data
        then = LATER | vars(self._reader.deserialize(data, kind))
        at: Any = then["header"]
        stamp = types["builtin_interfaces/msg/Time"](at.stamp.sec, at.stamp.nanosec)
        then["header"] = types["std_msgs/msg/Header"](stamp, at.frame_id)
        values = {each.name: then[each.name] for each in fields(types[kind])}
        return bytes(self._today.serialize_cdr(types[kind](**values), kind))
