"""Makes a whole recording of MCAP files that were not finished: all chunks before the first that is cut or damaged."""

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.rosbag2.storage_mcap import McapReader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from rabbit_recording import RecordingError
from rabbit_recording.bag_writer import BagWriter
from rabbit_recording.open_recording import MCAP_MAGIC, beside, check_definitions, one_line_errors, storage_files


@dataclass(frozen=True)
class Recovered:
    """The new folder and how many messages are in it."""

    path: Path
    messages: int


def recover(path: Path, out: Path | None = None) -> Recovered:
    """Write what is whole into the new folder `out`; by default it is beside the old one, `-recovered` after its name.

    Raises `RecordingError` if there is nothing to recover, or `out` is there already.
    """
    files = storage_files(path)
    folder = path if path.is_dir() else path.parent
    types, writer = get_typestore(Stores.EMPTY), None
    with one_line_errors(path):
        for connection, nanoseconds, data in (message for file in files for message in whole_messages(file)):
            writer = writer or BagWriter(out or beside(folder, f"{folder.resolve().name}-recovered"), types)
            if connection.topic not in writer.topics:
                assert isinstance(connection.ext, ConnectionExtRosbag2)
                types.register(get_types_from_msg(connection.msgdef.data, connection.msgtype))
                writer.add(connection.topic, connection.msgtype, connection.ext.offered_qos_profiles)
            writer.write(connection.topic, nanoseconds, data)
        if writer is None:
            raise RecordingError(f"recording {path}: no whole message in it")
        writer.close()
    return Recovered(writer.path, writer.messages)


def whole_messages(file: Path) -> Iterator[tuple[Connection, int, bytes]]:
    """Topic, time (ns) and bytes of all messages, in the order of recording, without the file's index."""
    reader = McapReader(file)
    with file.open("rb") as reader.bio:
        reader.data_start, reader.data_end = len(MCAP_MAGIC), file.stat().st_size
        with suppress(Exception):  # where the file is cut; the topics before are known
            reader.meta_scan()
        check_definitions(reader.connections)
        with suppress(Exception):
            yield from reader.messages_scan(reader.connections)
