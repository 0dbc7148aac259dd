"""A recording on disk: a rosbag2 folder with an MCAP file, definitions and QoS inside, which `rosbags` writes.

A chunk is closed and handed to the operating system every `FLUSH_SECONDS`, so that a killed recorder loses less than a
second. `recover` makes such a recording whole.
"""

import contextlib
import time
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import cast

from rosbags.interfaces import Connection, Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import StoragePlugin, Writer, WriterError
from rosbags.rosbag2.storage_mcap import McapWriter
from rosbags.typesys import Stores, TypesysError, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from rabbit_recording import RecordingError

FLUSH_SECONDS = 0.5
FOREVER = QosTime(9223372036, 854775807)  # as `ros2 bag` writes it


def graph_types(definitions: Iterable[Path]) -> Typestore:
    """ROS's own messages and those of `definitions`, folders of message packages (`share/PACKAGE`)."""
    store = get_typestore(Stores.ROS2_JAZZY)
    for share in definitions:
        add_types(store, share)
    return store


def add_types(store: Typestore, share: Path) -> None:
    """Adds the types of a message package, by its folder."""
    for file in sorted((share / "msg").glob("*.msg")):
        store.register(get_types_from_msg(file.read_text(encoding="utf-8"), f"{share.name}/msg/{file.stem}"))


def offered(depth: int, durability: str = "VOLATILE", reliability: str = "RELIABLE", history: str = "KEEP_LAST") -> Qos:
    """A QoS as a recording notes it, by the names that ROS has for it."""
    kept = QosHistory[history], depth, QosReliability[reliability], QosDurability[durability]
    return Qos(*kept, FOREVER, FOREVER, QosLiveliness.AUTOMATIC, FOREVER, avoid_ros_namespace_conventions=False)


class BagWriter:
    """Takes serialised messages.

    Raises `RecordingError` if the folder is there already, a type is not known, or nothing more can be written, as on a
    full disk; what is in the file by then stays there.
    """

    def __init__(self, path: Path, types: Typestore) -> None:
        self.path, self.messages = path, 0
        self.topics: dict[str, Connection] = {}
        self._types = types
        self._flushed = time.monotonic()
        self._is_open = False
        with self._errors():
            self._writer = Writer(path, version=9, storage_plugin=StoragePlugin.MCAP)
            self._writer.open()
        self._is_open = True

    def add(self, topic: str, type_name: str, qos: Iterable[Qos]) -> None:
        """Announce a topic by its full name."""
        with self._errors(f"topic {topic}: "):
            self.topics[topic] = self._writer.add_connection(
                topic, type_name, typestore=self._types, offered_qos_profiles=list(qos)
            )

    def write(self, topic: str, nanoseconds: int, data: bytes) -> None:
        """Append one message."""
        with self._errors():
            self._writer.write(self.topics[topic], nanoseconds, data)
        self.messages += 1
        if time.monotonic() - self._flushed > FLUSH_SECONDS:
            self.flush()

    def flush(self) -> None:
        """Hand what was written to the operating system; call it now and then while no message comes."""
        self._flushed = time.monotonic()
        storage = cast(McapWriter, self._writer.storage)
        with self._errors():
            if storage.chunk.msgs:
                storage.close_chunk()
                storage.bio.flush()

    def close(self) -> None:
        """Finish the file and its index; nothing after an error."""
        if self._is_open:
            with self._errors():
                self._writer.close()
            self._is_open = False

    @contextlib.contextmanager
    def _errors(self, where: str = "") -> Iterator[None]:
        """Raises errors as `RecordingError`; one of the system's ends the recording."""
        try:
            yield
        except (OSError, WriterError, TypesysError, KeyError) as error:
            if isinstance(error, OSError) and self._is_open:
                self._is_open = False
                with contextlib.suppress(OSError):
                    self._writer.abort()
            raise RecordingError(f"recording {self.path}: {where}{error}") from error
