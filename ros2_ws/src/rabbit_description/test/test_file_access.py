"""A file is replaced as a whole; one from outside is read whole or refused; YAML as all readers read it."""

import os
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from rabbit_description import GAITS, LIBRARIES
from rabbit_description.atomic_file import remove_partials, replacing
from rabbit_description.bounded_file import FileError, read_bytes, read_text
from rabbit_description.yaml_file import dump_yaml, parse_yaml, read_yaml


def test_what_was_written_takes_the_place_of_the_file_and_an_error_leaves_it(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.write_text("old")
    with replacing(file) as partial:
        partial.write_text("new")
        assert file.read_text() == "old"

    def fail() -> None:
        with replacing(file) as partial:
            partial.write_text("half")
            raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        fail()
    assert file.read_text() == "new"
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
            with pytest.raises(FileError, match=r"expected a regular file|No such"):  # there may be no terminal
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


ALIKE = ("7", "-3", "+5", "0", "0.5", ".5", "5.", "1e3", "-1.5E-3", ".inf", "true", "False", "null", "~", "stones")
ALIKE += ("9223372036854775807", "89ac228", "1.2.3", "'0200'", '"yes"', "[1, 2]", "{b: {c: 1}}")
DISPUTED = ("0200", "08", "0o17", "0x10", "0b1", "1_000", "3:20", "1:30.5", "9223372036854775808", "1e999", "00.5")
DISPUTED += ("yes", "No", "on", "OFF", "y", "N", "inf", "-Infinity", "nan", "2001-01-01", "=", "<<")


@pytest.mark.parametrize("text", DISPUTED)
def test_what_readers_read_differently_is_refused_with_line_key_and_value(text: str) -> None:
    with pytest.raises(FileError) as refused:
        parse_yaml(f"a: 1\nb:\n  - c: {text}\n")
    assert str(refused.value).startswith(f"line 3: b[0].c = {text}: readers of YAML disagree")


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("a: 1\na: 2", "line 2: key a: expected once"),
        ("a: &x 1", "line 1: a = x: expected no anchor or alias"),
        ("a: !!python/name:os.system", "expected no tag"),
        ("? [a]\n: 1", "line 1: a key: expected text"),
        ("a: 1\n---\na: 2", "line 2: a second document"),
        ("a: \x00", "control characters are not allowed"),
    ],
)
def test_what_no_file_needs_is_refused(text: str, said: str) -> None:
    with pytest.raises(FileError) as refused:
        parse_yaml(text)
    assert said in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("path", [*GAITS.glob("*.yaml"), *LIBRARIES.glob("*.yaml")], ids=lambda path: path.stem)
def test_the_shipped_files_mean_what_pyyaml_reads(path: Path) -> None:
    assert read_yaml(path) == yaml.safe_load(path.read_text(encoding="utf-8"))


texts = st.text(max_size=12) | st.sampled_from([*DISPUTED, *ALIKE])
scalars = st.none() | st.booleans() | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False) | texts
trees = st.recursive(scalars, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(texts, inner, max_size=4))


@settings(deadline=None)
@given(trees)
def test_what_is_written_is_read_again_by_us_and_by_pyyaml(tree: Any) -> None:
    text = dump_yaml({"a": tree})
    assert parse_yaml(text) == {"a": tree}
    assert yaml.safe_load(text) == {"a": tree}


@settings(deadline=None)
@given(st.text(alphabet="0123456789abcdefxoynYN_:.+-eE<=~ ", max_size=8))
def test_what_is_taken_is_what_pyyaml_reads(text: str) -> None:
    """But a number such as 1e3, which PyYAML alone takes for text."""
    try:
        found = parse_yaml(f"a: {text}")
    except FileError:
        return
    by_pyyaml = yaml.safe_load(f"a: {text}")
    if isinstance(found, dict) and isinstance(found["a"], float) and isinstance(by_pyyaml["a"], str):
        by_pyyaml["a"] = float(by_pyyaml["a"])
    assert found == by_pyyaml
