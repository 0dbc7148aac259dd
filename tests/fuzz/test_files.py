"""Files of every kind, cut, garbled or of another content: they are read, or refused in one line. Nothing else."""

import contextlib
import tempfile
from collections.abc import Callable
from itertools import accumulate
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from file_kinds import TINY, go_on, kept_files, transition
from hypothesis import example, given
from hypothesis import strategies as st
from rabbit_description import GAITS
from rabbit_description.gait import GaitError, load_gait, load_gaits
from rabbit_recording import RecordingError
from rabbit_recording.bag_writer import BagWriter
from rabbit_recording.contents import contents
from rabbit_recording.open_recording import one_line_errors, opened
from rabbit_recording.reader import iterate_episodes
from rabbit_recording.recover import recover
from rabbit_sim.restart_file import RestartFile, RestartFileError
from rabbit_sim.stones import CourseError, read_course
from recorded_walk import TYPES, in_sqlite3
from rl_cbf_clf_controller.parameters import CONFIG
from rl_cbf_clf_controller.parameters import ParameterError as ControllerParameterError
from rl_cbf_clf_controller.parameters import load_parameters as load_controller
from rl_trainer.checkpoint import CHECKPOINT, CheckpointError, journal_path, line_of, read_journal

COURSE = yaml.safe_dump({"stones": [{"l_min": 0.35, "l_max": 0.4}, {"l_min": 0.36}]}).encode()
CSV = b"l_min,l_max\n0.35,0.40\n0.36,0.41\n"
GAIT = (GAITS / "authors_035.yaml").read_bytes()
ONE = yaml.safe_load(GAIT)
OTHER = {**ONE, "step_length": 0.5}
LENGTH = ONE["step_length"]
GAIT_LIBRARY = yaml.safe_dump({"name": "two", "start_length": LENGTH, "gaits": [ONE, OTHER]}).encode()
AUTHORS = (CONFIG / "authors.yaml").read_bytes()

scalars = st.one_of(
    st.none(), st.booleans(), st.integers(), st.floats(), st.text(max_size=8), st.sampled_from(["0x", "2001-99-99"])
)
DEEP = b"[" * 3000
contents_of_yaml = st.recursive(
    scalars, lambda inner: st.lists(inner, max_size=4) | st.dictionaries(scalars, inner, max_size=4), max_leaves=12
)


@st.composite
def damaged(draw: st.DrawFn, whole: bytes) -> bytes:
    """The bytes of a sound file with some replaced, taken out or put in, and perhaps cut."""
    data = bytearray(whole)
    for _ in range(draw(st.integers(0, 4))):
        place = draw(st.integers(0, len(data)))
        data[place : place + draw(st.integers(0, 8))] = draw(st.binary(max_size=8))
    return bytes(data[: draw(st.integers(0, len(data)))]) if draw(st.booleans()) else bytes(data)


def texts(whole: bytes) -> st.SearchStrategy[bytes]:
    """What a YAML file may hold."""
    trees = contents_of_yaml.map(lambda tree: yaml.safe_dump(tree).encode())
    known = st.dictionaries(st.sampled_from(sorted(yaml.safe_load(whole))), contents_of_yaml, max_size=4)
    changed = known.map(lambda new: yaml.safe_dump({**yaml.safe_load(whole), **new}).encode())
    return st.one_of(damaged(whole), trees, changed, st.binary(max_size=60))


def read_or_refused(read: Callable[[Path], Any], error: type[Exception], name: str, data: bytes) -> None:
    """Write the file and read it: nothing but `error` is raised, and it names the file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / name
        path.write_bytes(data)
        refusal = str(path.parent)
        try:
            read(path)
        except error as reason:
            refusal = str(reason)
        assert str(path.parent) in refusal


@example(DEEP)
@given(texts(GAIT))
def test_gaits(data: bytes) -> None:
    read_or_refused(load_gait, GaitError, "gait.yaml", data)


@example(DEEP)
@given(texts(GAIT_LIBRARY))
def test_gait_libraries(data: bytes) -> None:
    read_or_refused(load_gaits, GaitError, "library.yaml", data)


@example(DEEP)
@given(texts(COURSE))
def test_courses_in_yaml(data: bytes) -> None:
    read_or_refused(lambda path: read_course(path, 2, 0.05), CourseError, "course.yaml", data)


@given(damaged(CSV) | st.binary(max_size=80) | st.text(max_size=80).map(lambda text: text.encode("utf-8")))
def test_courses_in_csv(data: bytes) -> None:
    read_or_refused(lambda path: read_course(path, 2, 0.05), CourseError, "course.csv", data)


@example(DEEP)
@given(texts(AUTHORS))
def test_controller_parameters(data: bytes) -> None:
    read_or_refused(load_controller, ControllerParameterError, "parameters.yaml", data)


@given(st.binary(max_size=40) | damaged(bytes(32)))
def test_simulator_memories(data: bytes) -> None:
    read_or_refused(RestartFile, RestartFileError, "memory", data)


# What a trainer keeps

CHECKPOINT_BYTES, JOURNAL_BYTES = kept_files()
JOURNAL_LINES = [line_of(transition(tick), TINY) for tick in range(3)]


@given(damaged(CHECKPOINT_BYTES) | st.binary(max_size=60))
def test_checkpoints(data: bytes) -> None:
    read_or_refused(go_on, CheckpointError, CHECKPOINT, data)


@given(damaged(JOURNAL_BYTES) | st.binary(max_size=60))
def test_journals(data: bytes) -> None:
    read_or_refused(go_on, CheckpointError, journal_path(Path(), 0).name, data)


@given(st.integers(0, len(JOURNAL_BYTES)))
def test_a_cut_journal_holds_all_that_is_whole(length: int) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = journal_path(Path(folder), 0)
        path.write_bytes(JOURNAL_BYTES[:length])
        held, ends = read_journal(path, TINY), list(accumulate(map(len, JOURNAL_LINES)))
        assert [each.tick for each in held] == list(range(sum(length >= end - 1 for end in ends)))
        for each in held:
            np.testing.assert_array_equal(each.observation, transition(each.tick).observation)


# Recordings


def recorded(storage: str) -> tuple[str, bytes]:
    """Name and bytes of a small sound recording's file."""
    with tempfile.TemporaryDirectory() as folder:
        writer = BagWriter(Path(folder) / "bag", TYPES)
        writer.add("/state", "rabbit_msgs/msg/RobotState", [])
        writer.add("/episode", "rabbit_msgs/msg/Episode", [])
        for tick in range(4):
            writer.write("/state", tick * 10_000_000, bytes([0, 1]) + bytes(200))
            writer.flush()
        writer.close()
        bag = writer.path if storage == "mcap" else in_sqlite3(writer.path, Path(folder) / "sqlite3")
        (file,) = (each for each in bag.iterdir() if each.suffix in (".mcap", ".db3"))
        return file.name, file.read_bytes()


BAGS = {storage: recorded(storage) for storage in ("mcap", "sqlite3")}


def use_bag(path: Path) -> None:
    """All that is done with a recording; each may refuse it."""
    for use in (contents, lambda bag: list(iterate_episodes(bag)), lambda bag: recover(bag, bag.parent / "recovered")):
        with contextlib.suppress(RecordingError):
            use(path)
    with opened(path) as reader, one_line_errors(path):
        list(reader.messages())


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
@given(st.data())
def test_recordings(storage: str, data: st.DataObject) -> None:
    name, whole = BAGS[storage]
    content = data.draw(damaged(whole) | st.binary(max_size=60))
    read_or_refused(use_bag, RecordingError, name, content)
