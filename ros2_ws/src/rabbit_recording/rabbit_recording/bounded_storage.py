"""Readers of storage files that are not trusted: what is read takes time and memory in proportion to the file.

A few bytes can stand for many: a compressed chunk, an index that names one chunk a thousand times, an array of 4e9
values in a message definition, a column that a database computes. Each is refused when the recording is opened.
"""

import re
import sqlite3
from collections.abc import Iterable, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import lz4.frame  # type: ignore[import-untyped]
from backports import zstd
from rabbit_description.yaml_file import read_mapping
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader, ReaderError
from rosbags.rosbag2.reader import DirectoryReader
from rosbags.rosbag2.storage_mcap import DECOMPRESSORS, McapReader
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader

MOST_RATIO = 30  # of a chunk's bytes to its compressed ones; numbers of a walk have less than 10
SMALL = 1_000_000  # bytes that a chunk may always have
MOST_TOPICS = 1000
MOST_DEFINITION = 100_000  # characters of a message definition with all that it contains
LONGEST_ARRAY = 100_000  # fixed, in a message definition
LONGEST_VALUE = 100_000_000  # bytes of a value in a database
COMPUTES = re.compile(r"\b(AS|CHECK|GENERATED|VIEW|TRIGGER|VIRTUAL)\b", re.IGNORECASE)


class BoundedMcapReader(McapReader):
    """An MCAP file whose index names each chunk once, in it."""

    def open(self) -> None:
        """Raises `ReaderError`."""
        super().open()
        try:
            end = 0
            for begin, length in sorted((chunk.chunk_start_offset, chunk.chunk_length) for chunk in self.chunks):
                if begin < end:
                    raise ReaderError(f"chunks at {begin} overlap: expected each once")
                end = begin + length
            if end > self.data_end:
                raise ReaderError(f"a chunk ends at {end}: expected at most {self.data_end}")
            check_connections(self.connections)
        except ReaderError:
            self.close()
            raise


class BoundedSqlite3Reader(Sqlite3Reader):
    """A sound database of plain tables."""

    def open(self) -> None:
        """Raises `ReaderError`."""
        check_database(Path(str(self.path)))
        super().open()
        try:
            check_connections(self.connections)
        except ReaderError:
            self.close()
            raise


class _Folder(DirectoryReader):
    STORAGE_PLUGINS: Mapping[str, Any] = {"mcap": BoundedMcapReader, "sqlite3": BoundedSqlite3Reader}

    def open(self) -> None:
        check_metadata(Path(str(self.path)))
        super().open()


class _Recording(Reader):
    STORAGE_PLUGINS: Mapping[str, Any] = {"dir": _Folder, ".mcap": BoundedMcapReader, ".db3": BoundedSqlite3Reader}


def bounded_reader(path: Path) -> AnyReader:
    """Reads a folder or a file; `open` raises what rosbags does, and at a bomb."""
    reader = AnyReader([path])
    reader.readers = [_Recording(path)]
    return reader


def check_metadata(folder: Path) -> None:
    """Raise `FileError` or `ReaderError` for a folder's metadata.yaml that names other files than those in it."""
    found = read_mapping(folder / "metadata.yaml").get("rosbag2_bagfile_information")
    if not isinstance(found, dict):
        raise ReaderError("metadata.yaml: expected rosbag2_bagfile_information")
    names = found.get("relative_file_paths")
    there = {file.name for file in folder.iterdir() if file.suffix in (".mcap", ".db3")}
    if not isinstance(names, list) or len(set(map(str, names))) < len(names) or not there.issuperset(map(str, names)):
        raise ReaderError(f"metadata.yaml: relative_file_paths: expected some of {sorted(there)}, each once")
    if found.get("compression_mode") not in (None, "", "none", "NONE"):
        raise ReaderError("metadata.yaml: compression_mode: expected none; `ros2 bag convert` decompresses it")


def check_connections(connections: Iterable[Connection]) -> None:
    """Raise `ReaderError` for too many topics, or a message definition from which very much would follow."""
    definitions = {(each.msgtype, each.msgdef.data) for each in connections}
    if len(definitions) > MOST_TOPICS:
        raise ReaderError(f"{len(definitions)} types: expected at most {MOST_TOPICS}")
    for kind, text in definitions:
        if len(text) > MOST_DEFINITION:
            raise ReaderError(f"definition of {kind[:100]}: expected at most {MOST_DEFINITION} characters")
        lengths = re.findall(r"\[\s*(\d+)\s*\]", re.sub(r"#.*", "", text))
        if any(len(length) > 9 or int(length) > LONGEST_ARRAY for length in lengths):
            raise ReaderError(f"definition of {kind[:100]}: an array of more than {LONGEST_ARRAY} values")


def check_database(file: Path) -> None:
    """Raise `ReaderError` for a database that is damaged or that computes what is read from it."""
    try:
        with closing(sqlite3.connect(f"{file.absolute().as_uri()}?immutable=1&mode=ro", uri=True)) as database:
            database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LONGEST_VALUE)
            for (text,) in database.execute("SELECT sql FROM sqlite_master WHERE sql IS NOT NULL"):
                if found := COMPUTES.search(str(text)):
                    raise ReaderError(f"a table with {found[0]}: expected columns of plain values")
            (said,) = database.execute("PRAGMA quick_check(1)").fetchone()
    except sqlite3.Error as error:
        raise ReaderError(f"database: {error}") from error
    if said != "ok":
        raise ReaderError(f"database: {said[:200]}")


def _check_size(data: bytes, size: int) -> None:
    if size > (most := max(SMALL, MOST_RATIO * len(data))):
        raise ReaderError(f"a chunk of {size} bytes in {len(data)}: expected at most {most}")


def _zstd(data: bytes, size: int) -> bytes:
    _check_size(data, size)
    return bytes(zstd.ZstdDecompressor().decompress(data, max_length=size + 1))


def _lz4(data: bytes, size: int) -> bytes:
    _check_size(data, size)
    return bytes(lz4.frame.LZ4FrameDecompressor().decompress(data, max_length=size + 1))


DECOMPRESSORS.update(zstd=_zstd, lz4=_lz4)  # rosbags' own take what comes out, however much it is
