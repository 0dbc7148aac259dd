"""A file is replaced as a whole, or stays as it was."""

import errno
from pathlib import Path

import pytest
from rabbit_description.atomic_file import replace_text, replacing


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


def test_an_error_has_the_name_of_the_file(tmp_path: Path) -> None:
    file = tmp_path / "file"

    def write() -> None:
        with replacing(file) as partial:
            partial.write_text("half")
            raise OSError(errno.ENOSPC, "No space left on device")

    with pytest.raises(OSError, match="No space left on device") as told:
        write()
    assert (told.value.errno, told.value.filename) == (errno.ENOSPC, str(file))
    with pytest.raises(NotADirectoryError) as told:
        replace_text(Path(__file__) / "below", "text")
    assert told.value.filename == str(Path(__file__) / "below")


def test_two_writers_at_once_both_end_whole(tmp_path: Path) -> None:
    file = tmp_path / "file"
    with replacing(file) as first:
        first.write_text("first")
        with replacing(file) as second:
            second.write_text("second")
        assert file.read_text() == "second"
    assert file.read_text() == "first"
    assert list(tmp_path.iterdir()) == [file]
