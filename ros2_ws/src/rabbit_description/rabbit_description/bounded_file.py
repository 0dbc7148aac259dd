"""Reads files that are not trusted: regular files alone, of a bounded size."""

import json
import os
import stat
import zlib
from contextlib import suppress
from pathlib import Path
from typing import Any

from rabbit_description.validation import one_line


class FileError(ValueError):
    """A file that cannot be read, in one line without its name."""


def read_bytes(path: Path, most: int) -> bytes:
    """Read a regular file of at most `most` bytes. It never blocks: a pipe or a device is refused.

    Raises:
        FileError: no such file, not readable, not a regular file, or too large.
    """
    try:
        _check(path.stat(), most)
        with os.fdopen(os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC), "rb", 0) as file:
            status = os.fstat(file.fileno())
            _check(status, most)
            data = file.read(status.st_size) or b""
            if file.read(1) != b"":  # a file of /proc, which says that it has 0 bytes, and may never end
                raise FileError("has more bytes than its size says; expected a regular file")
            return data
    except OSError as error:
        raise FileError(error.strerror or str(error)) from error
    except ValueError as error:  # a path that holds a zero byte
        raise FileError(str(error)) from error


def is_file(path: Path) -> bool:
    """Whether it is a regular file; False too where no file can have this name, as one of 300 characters."""
    with suppress(OSError):
        return path.is_file()
    return False


def exists(path: Path) -> bool:
    """Whether there is something; False too where nothing can have this name."""
    with suppress(OSError):
        return path.exists()
    return False


def read_text(path: Path, most: int) -> str:
    """The same as UTF-8 text; raises `FileError`."""
    try:
        return read_bytes(path, most).decode("utf-8")
    except UnicodeDecodeError as error:
        raise FileError(f"no UTF-8 text: byte {error.start}") from error


def parse_json(text: str) -> Any:
    """Plain data; raises `FileError` for what is no JSON or nested too deep."""
    try:
        return json.loads(text)
    except RecursionError as error:
        raise FileError("nested too deep") from error
    except ValueError as error:
        raise FileError(one_line(error)) from error


def gunzip(data: bytes, most: int) -> bytes:
    """What gzip compressed, at most `most` bytes; raises `FileError`."""
    stream = zlib.decompressobj(wbits=31)
    try:
        content = stream.decompress(data, most)
    except zlib.error as error:
        raise FileError(str(error)) from error
    if not stream.eof:
        raise FileError(f"cut, or more than {most} bytes")
    return content


def _check(status: os.stat_result, most: int) -> None:
    if not stat.S_ISREG(status.st_mode):
        raise FileError("expected a regular file, not a directory, device or pipe")
    if status.st_size > most:
        raise FileError(f"{status.st_size} bytes: expected {most} at most")
