"""Opens a recording: a rosbag2 folder, or its MCAP file. Whatever is wrong with it becomes one line.

The files are read, not the folder's metadata.yaml. They are not trusted: a few bytes can stand for many, as a
compressed chunk, an index that names one chunk a thousand times, or an array of 4e9 values in a message definition.
Each is refused, so that time and memory stay in proportion to the file.
"""

import contextlib
import re
import sys
from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import lz4.frame  # type: ignore[import-untyped]
from rabbit_description.bounded_file import exists
from rabbit_description.validation import one_line
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection
from rosbags.rosbag2 import Reader, ReaderError
from rosbags.rosbag2.storage_mcap import DECOMPRESSORS, McapReader

from rabbit_recording import RecordingError

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

MCAP_MAGIC = b"\x89MCAP0\r\n"  # the first and the last bytes of a finished file
MOST_RATIO = 30  # of a chunk's bytes to its compressed ones; numbers of a walk have less than 10
SMALL = 1_000_000  # bytes that a chunk may always have
MOST_TOPICS = 1000
MOST_DEFINITION = 100_000  # characters of a message definition with all that it contains
LONGEST_ARRAY = 100_000  # fixed, in a message definition


@contextlib.contextmanager
def opened(path: Path) -> Iterator[AnyReader]:
    """The recording, open; raises `RecordingError`."""
    files = storage_files(path)
    if any(map(is_unfinished, files)):
        raise RecordingError(
            f"recording {path}: not finished, its recorder was killed, ran out of disk or still runs; "
            f"`rabbit bag recover {path}` makes a whole one of it"
        )
    with one_line_errors(path):
        reader = AnyReader(files)
        reader.readers = [_BoundedReader(file) for file in files]
        reader.open()
    with contextlib.closing(reader):
        yield reader


def begin_of(reader: AnyReader) -> int:
    """When the first state is stored, ns: before it lies what was announced earlier. Of none, when anything is."""
    states = [connection for connection in reader.connections if last_name(connection.topic) == "state"]
    return next((at for _, at, _ in reader.messages(states)), reader.start_time) if states else reader.start_time


def last_name(topic: str) -> str:
    """`state` of `/left/state`."""
    return topic.split("/")[-1]


def storage_files(path: Path) -> list[Path]:
    """The files that hold the messages; raises `RecordingError` if there are none."""
    if not exists(path):
        raise RecordingError(f"recording {path}: no such file or folder")
    with one_line_errors(path):
        files = sorted(file for file in (path.iterdir() if path.is_dir() else [path]) if file.suffix == ".mcap")
    if not files:
        raise RecordingError(f"recording {path}: expected a rosbag2 folder, or its .mcap file")
    if odd := next((file for file in files if not file.is_file()), None):
        raise RecordingError(f"recording {odd}: expected a regular file, not a directory, device or pipe")
    return files


def beside(path: Path, name: str) -> Path:
    """What has this name in the folder in which a file or folder lies, `.` and `..` too."""
    return (path.parent if path.name.strip(".") else path / "..") / name


def is_unfinished(file: Path) -> bool:
    """Without its end."""
    with one_line_errors(file), file.open("rb") as stream:
        begins = stream.read(len(MCAP_MAGIC)) == MCAP_MAGIC
        at = stream.seek(-len(MCAP_MAGIC), 2) if begins else 0
        return begins and (at < len(MCAP_MAGIC) or stream.read() != MCAP_MAGIC)


@contextlib.contextmanager
def one_line_errors(path: Path, meaning: str = "damaged, or of another kind") -> Iterator[None]:
    """Errors as one line, a `RecordingError`; `meaning`: of them. A damaged file may raise anything."""
    try:
        yield
    except RecordingError:
        raise
    except Exception as error:
        text = one_line(error) or type(error).__name__
        raise RecordingError(f"recording {path}: {meaning}: {text}") from error


class _BoundedMcapReader(McapReader):
    """An MCAP file whose index names each chunk once, in it."""

    def _open(self) -> None:
        super()._open()
        end = 0
        for begin, length in sorted((chunk.chunk_start_offset, chunk.chunk_length) for chunk in self.chunks):
            if begin < end:
                raise ReaderError(f"chunks at {begin} overlap: expected each once")
            end = begin + length
        if end > self.data_end:
            raise ReaderError(f"a chunk ends at {end}: expected at most {self.data_end}")
        check_definitions(self.connections)


class _BoundedReader(Reader):
    STORAGE_PLUGINS: Mapping[str, Any] = {".mcap": _BoundedMcapReader}


def check_definitions(connections: Iterable[Connection]) -> None:
    """Raise `ReaderError` for too many topics, or a message definition from which very much would follow."""
    definitions = {(connection.msgtype, connection.msgdef.data) for connection in connections}
    if len(definitions) > MOST_TOPICS:
        raise ReaderError(f"{len(definitions)} types: expected at most {MOST_TOPICS}")
    for kind, text in definitions:
        if len(text) > MOST_DEFINITION:
            raise ReaderError(f"definition of {kind[:100]}: expected at most {MOST_DEFINITION} characters")
        lengths = re.findall(r"\[\s*(\d+)\s*\]", re.sub(r"#.*", "", text))
        if any(len(length) > 9 or int(length) > LONGEST_ARRAY for length in lengths):
            raise ReaderError(f"definition of {kind[:100]}: an array of more than {LONGEST_ARRAY} values")


def _decompress(kind: Any, data: bytes, size: int) -> bytes:
    if size > (most := max(SMALL, MOST_RATIO * len(data))):
        raise ReaderError(f"a chunk of {size} bytes in {len(data)}: expected at most {most}")
    return bytes(kind().decompress(data, max_length=size + 1))


# those of rosbags take what comes out, however much it is
DECOMPRESSORS["zstd"] = partial(_decompress, zstd.ZstdDecompressor)
DECOMPRESSORS["lz4"] = partial(_decompress, lz4.frame.LZ4FrameDecompressor)
