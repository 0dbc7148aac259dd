"""A recording on disk: a rosbag2 folder that `ros2 bag`, Foxglove and `rosbags` read, definitions and QoS inside."""

from collections.abc import Iterable
from pathlib import Path
from typing import Literal

from rosbags.interfaces import Connection, Qos
from rosbags.rosbag2 import StoragePlugin, Writer, WriterError
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

Storage = Literal["mcap", "sqlite3"]


class RecordingError(RuntimeError):
    """A recording that cannot be written or read."""


class BagWriter:
    """Takes serialised messages. Open, write and close it in one thread: sqlite3 wants that."""

    def __init__(self, path: Path, storage: Storage, definitions: Iterable[Path] = ()) -> None:
        """`definitions`: folders `share/PACKAGE` of message packages beyond ROS's own.

        Raises:
            RecordingError: the folder is there already or cannot be made.
        """
        self._typestore = get_typestore(Stores.ROS2_JAZZY)
        for share in definitions:
            for file in sorted((share / "msg").glob("*.msg")):
                text = file.read_text(encoding="utf-8")
                self._typestore.register(get_types_from_msg(text, f"{share.name}/msg/{file.stem}"))
        plugin = StoragePlugin.MCAP if storage == "mcap" else StoragePlugin.SQLITE3
        self._writer = Writer(path, version=9, storage_plugin=plugin)
        self._connections: dict[str, Connection] = {}
        try:
            self._writer.open()
        except (OSError, WriterError) as error:
            raise RecordingError(f"recording {path}: {error}") from error

    def add(self, topic: str, type_name: str, qos: Qos) -> None:
        """Announce a topic by its full name."""
        self._connections[topic] = self._writer.add_connection(
            topic, type_name, typestore=self._typestore, offered_qos_profiles=[qos]
        )

    def write(self, topic: str, nanoseconds: int, data: bytes) -> None:
        """Append one message."""
        self._writer.write(self._connections[topic], nanoseconds, data)

    def close(self) -> None:
        """Finish the files and their index."""
        self._writer.close()
