"""A file is replaced as a whole, or stays as it was."""

import subprocess
import sys
from pathlib import Path

import pytest
from rabbit_description.atomic_file import remove_partials, replacing


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
