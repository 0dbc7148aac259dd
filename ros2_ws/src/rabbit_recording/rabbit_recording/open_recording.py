"""Opens a recording: a rosbag2 folder, or its MCAP or sqlite3 file. Whatever is wrong with it becomes one line."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

from rabbit_description.bounded_file import one_line
from rosbags.highlevel import AnyReader

from rabbit_recording.bag_writer import RecordingError
from rabbit_recording.bounded_storage import bounded_reader

SUFFIXES = (".mcap", ".db3")
SQLITE_MAGIC = b"SQLite format 3\0"
MCAP_MAGIC = b"\x89MCAP0\r\n"  # the first and the last bytes of a finished file


@contextlib.contextmanager
def opened(path: Path) -> Iterator[AnyReader]:
    """The recording, open; raises `RecordingError`."""
    if any(is_unfinished(file) for file in storage_files(path)) or (
        path.is_dir() and not (path / "metadata.yaml").is_file()
    ):
        raise RecordingError(
            f"recording {path}: not finished, its recorder was killed, ran out of disk or still runs; "
            f"`rabbit bag recover {path}` makes a whole one of it"
        )
    for file in storage_files(path):
        refuse_cut(file)
    with one_line_errors(path):
        reader = bounded_reader(path)
        reader.open()
    try:
        yield reader
    finally:
        reader.close()


def begin_of(reader: AnyReader) -> int:
    """When the first state is stored, ns: before it lies what was announced earlier. Of none, when anything is."""
    states = [connection for connection in reader.connections if last_name(connection.topic) == "state"]
    first = next(iter(reader.messages(states)), None) if states else None
    return first[1] if first else reader.start_time


def last_name(topic: str) -> str:
    """`state` of `/left/state`."""
    return topic.split("/")[-1]


def storage_files(path: Path) -> list[Path]:
    """The files that hold the messages; raises `RecordingError` if there are none."""
    if not path.exists():
        raise RecordingError(f"recording {path}: no such file or folder")
    with one_line_errors(path):
        files = sorted(file for file in (path.iterdir() if path.is_dir() else [path]) if file.suffix in SUFFIXES)
    if not files:
        raise RecordingError(f"recording {path}: expected a rosbag2 folder, or its .mcap or .db3 file")
    for file in files:
        if not file.is_file():
            raise RecordingError(f"recording {file}: expected a regular file, not a directory, device or pipe")
    return files


def is_unfinished(file: Path) -> bool:
    """An MCAP file without its end, or a database with a transaction under way."""
    if file.suffix != ".mcap":
        return file.with_name(f"{file.name}-journal").exists()
    with one_line_errors(file), file.open("rb") as stream:
        size = file.stat().st_size
        begins = stream.read(len(MCAP_MAGIC)) == MCAP_MAGIC
        stream.seek(-min(len(MCAP_MAGIC), size), 2)
        return begins and (size < 2 * len(MCAP_MAGIC) or stream.read() != MCAP_MAGIC)


def refuse_cut(file: Path) -> None:
    """Raise `RecordingError` for a file that does not begin as its kind does, or a database that has lost its end."""
    with one_line_errors(file), file.open("rb") as stream:
        size, head = file.stat().st_size, stream.read(32)
    is_mcap = file.suffix == ".mcap"
    magic = MCAP_MAGIC if is_mcap else SQLITE_MAGIC
    if not head.startswith(magic):
        raise RecordingError(
            f"recording {file}: {size} bytes that are no {'MCAP file' if is_mcap else 'sqlite3 database'}"
        )
    if not is_mcap:  # its header says how many pages of how many bytes there are; a page size of 1 means 65536
        page, pages = int.from_bytes(head[16:18], "big"), int.from_bytes(head[28:32], "big")
        if size < (whole := (page if page > 1 else 65536) * pages) or len(head) < 32:
            raise RecordingError(f"recording {file}: cut, {size} of {whole} bytes are there")


@contextlib.contextmanager
def one_line_errors(
    path: Path, found: str = "damaged, or of another kind", errors: tuple[type[Exception], ...] = (Exception,)
) -> Iterator[None]:
    """Errors as one line, a `RecordingError`; `found` is what they mean. A damaged file may raise anything."""
    try:
        yield
    except RecordingError:
        raise
    except errors as error:
        text = one_line(error) or type(error).__name__
        raise RecordingError(f"recording {path}: {found}: {text}") from error
