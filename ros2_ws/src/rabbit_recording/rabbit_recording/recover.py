"""Makes a whole recording of one that was not finished: all whole chunks of MCAP, all committed messages of sqlite3.

A killed recorder leaves an MCAP file without index and end, its last record perhaps cut; or a database whose last
transaction sqlite3 itself takes back. The original stays as it is.
"""

import contextlib
import shutil
import sqlite3
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import BinaryIO

from rosbags.interfaces import Connection, ConnectionExtRosbag2
from rosbags.interfaces.typing import Typesdict
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from rabbit_recording.bag_writer import BagWriter, RecordingError, Storage
from rabbit_recording.bounded_storage import BoundedMcapReader, BoundedSqlite3Reader, check_connections
from rabbit_recording.open_recording import MCAP_MAGIC, is_unfinished, one_line_errors, refuse_cut, storage_files

HEADER, DATA_END = 0x01, 0x0F  # MCAP records: an opcode, 8 bytes of length, the content


@dataclass(frozen=True)
class Recovered:
    """What came of it: the new folder, its messages, and how many bytes at the end were no whole record."""

    path: Path
    messages: int
    cut_bytes: int


@dataclass(frozen=True)
class Whole:
    """What is whole in one file, in the order of recording."""

    connections: list[Connection]
    messages: Iterator[tuple[Connection, int, bytes]]
    count: int
    cut_bytes: int = 0


def recover(path: Path, out: Path | None = None) -> Recovered:
    """Write what is whole into the new folder `out`; by default it is beside the old one, `-recovered` after its name.

    Raises:
        RecordingError: nothing to recover, or `out` is there already.
    """
    files = storage_files(path)
    folder = path if path.is_dir() else path.parent
    out = out or folder.with_name(f"{folder.resolve().name}-recovered")
    storage: Storage = "mcap" if files[0].suffix == ".mcap" else "sqlite3"
    with one_line_errors(path), contextlib.ExitStack() as stack:
        parts = [stack.enter_context(whole_mcap(f) if f.suffix == ".mcap" else whole_sqlite3(f)) for f in files]
        if not sum(part.count for part in parts):
            raise RecordingError(f"recording {path}: no whole message in it")
        topics = {each.topic: each for part in parts for each in part.connections}
        writer = BagWriter(out, storage, types_of(topics.values()))
        for topic, connection in topics.items():
            assert isinstance(connection.ext, ConnectionExtRosbag2)
            writer.add(topic, connection.msgtype, connection.ext.offered_qos_profiles)
        for part in parts:
            for connection, nanoseconds, data in part.messages:
                writer.write(connection.topic, nanoseconds, data)
        writer.close()
        return Recovered(out, writer.messages, sum(part.cut_bytes for part in parts))


def types_of(connections: Iterable[Connection]) -> Typestore:
    """The message types as a recording itself defines them."""
    found: Typesdict = {}
    for connection in connections:
        found |= get_types_from_msg(connection.msgdef.data, connection.msgtype)
    store = get_typestore(Stores.EMPTY)
    store.register(found)
    return store


@contextlib.contextmanager
def whole_mcap(file: Path) -> Iterator[Whole]:
    """An MCAP file up to its last whole record."""
    reader = BoundedMcapReader(file)
    with file.open("rb") as stream:
        size = file.stat().st_size
        begin, end, is_cut = whole_records(stream, size)
        reader.bio, reader.data_start, reader.data_end = stream, begin, end
        reader.meta_scan()
        check_connections(reader.connections)
        count = reader.statistics.message_count if reader.statistics else 0
        yield Whole(reader.connections, reader.messages_scan(reader.connections), count, is_cut * (size - end))


def whole_records(stream: BinaryIO, size: int) -> tuple[int, int, bool]:
    """Where the messages begin and end in an MCAP file of `size` bytes, and whether it is cut there."""
    if not MCAP_MAGIC.startswith(stream.read(len(MCAP_MAGIC))):
        raise RecordingError(f"{stream.name}: no MCAP file")
    begin = end = 0
    while len(head := stream.read(9)) == 9:
        after = stream.tell() + int.from_bytes(head[1:], "little")
        if after > size or head[0] == DATA_END:
            break
        end = stream.seek(after)
        begin = begin or end  # after the header
    return begin, end, head[:1] != bytes([DATA_END])


@contextlib.contextmanager
def whole_sqlite3(file: Path) -> Iterator[Whole]:
    """A copy of a database, from which sqlite3 takes back what was not committed."""
    if not is_unfinished(file):
        refuse_cut(file)
    with TemporaryDirectory() as folder:
        copy = Path(folder) / file.name
        files = [file, *(each for each in file.parent.glob(f"{file.name}-*") if each.is_file())]  # the journal, if any
        for each in files:
            shutil.copy(each, folder)
        with contextlib.closing(sqlite3.connect(copy)) as database:
            database.execute("SELECT count(*) FROM sqlite_master").fetchone()
        if copy.stat().st_size > sum(each.stat().st_size for each in files):
            raise RecordingError(f"recording {file}: its journal asks for more bytes than there are")
        reader = BoundedSqlite3Reader(copy)
        reader.open()
        try:
            connections = reader.connections
            yield Whole(connections, reader.messages(connections), sum(each.msgcount for each in connections))
        finally:
            reader.close()
