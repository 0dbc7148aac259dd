"""A file is replaced as a whole or stays as it was; one from outside is read whole or refused at once."""

import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest
from rabbit_description.atomic_file import remove_partials, replacing
from rabbit_description.bounded_file import FileError, read_bytes, read_text


def test_what_was_written_takes_the_place_of_the_file(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("old")
    with replacing(file) as partial:
        partial.write_text("new")
        assert file.read_text() == "old"
    assert file.read_text() == "new"
    assert list(tmp_path.iterdir()) == [file]


def test_an_error_leaves_the_file_as_it_was(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("old")

    def fail() -> None:
        with replacing(file) as partial:
            partial.write_text("half")
            raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        fail()
    assert file.read_text() == "old"
    assert list(tmp_path.iterdir()) == [file]


def test_what_a_killed_writer_leaves_is_removed_and_nothing_else(tmp_path: Path) -> None:
    """Not what another writer is at, and nothing foreign."""
    folder = tmp_path / "below"
    folder.mkdir()
    script = f"""
from pathlib import Path
from rabbit_description.atomic_file import replacing
with replacing(Path({str(folder / "killed.txt")!r})) as partial:
    partial.write_text("half")
    print(flush=True)
    input()
"""
    writer = subprocess.Popen([sys.executable, "-c", script], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    assert writer.stdout is not None
    writer.stdout.readline()
    writer.kill()
    writer.communicate()
    (left,) = folder.iterdir()
    foreign = [folder / ".hidden", folder / "killed.txt", folder / f".{'0' * 31}.short", folder / f"{'0' * 32}.seen"]
    for path in foreign:
        path.write_text("theirs")
    with replacing(folder / "living.txt") as partial:
        partial.write_text("whole")
        remove_partials(tmp_path)
        assert partial.exists()
    assert not left.exists()
    assert sorted(folder.iterdir()) == sorted([*foreign, folder / "living.txt"])
    assert (folder / "living.txt").read_text() == "whole"


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
