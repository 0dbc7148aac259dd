"""A file from outside: read whole, or refused at once, whatever its path names."""

import os
import socket
from pathlib import Path

import pytest
from rabbit_description.bounded_file import FileError, read_bytes, read_text

NOT_REGULAR = "expected a regular file"


def test_a_file_of_the_largest_size_is_read(tmp_path: Path) -> None:
    path = tmp_path / "file"
    path.write_bytes(b"12345")
    assert read_bytes(path, 5) == b"12345"
    with pytest.raises(FileError, match="5 bytes: expected 4 at most"):
        read_bytes(path, 4)


def test_what_is_no_regular_file_is_refused(tmp_path: Path) -> None:
    pipe, link, bound = tmp_path / "pipe", tmp_path / "link", tmp_path / "socket"
    os.mkfifo(pipe)
    link.symlink_to(pipe)
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(str(bound))
        for path in (pipe, link, bound, tmp_path, Path("/dev/zero"), Path("/dev/tty")):
            with pytest.raises(FileError, match=f"{NOT_REGULAR}|No such"):  # there may be no terminal
                read_bytes(path, 100)


def test_errors_are_one_line(tmp_path: Path) -> None:
    latin = tmp_path / "latin"
    latin.write_bytes("ö".encode("latin-1"))
    (loop := tmp_path / "loop").symlink_to(loop)
    for path in (latin, loop, tmp_path / "none", tmp_path / ("x" * 300), Path("a\0b"), latin / "below"):
        with pytest.raises(FileError) as refused:
            read_text(path, 100)
        assert str(refused.value)
        assert "\n" not in str(refused.value)
