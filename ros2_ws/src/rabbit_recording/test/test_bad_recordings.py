"""Whatever is handed over as a recording: it is read, or refused in one line with exit code 2."""

import contextlib
import random
import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rabbit_recording import RecordingError
from rabbit_recording.bag_writer import BagWriter, graph_types
from rabbit_recording.commands.bag import app
from rabbit_recording.contents import contents
from rabbit_recording.open_recording import MCAP_MAGIC
from rabbit_recording.reader import read_episodes
from rabbit_recording.recover import recover
from recorded_walk import DRAWS, MESSAGES
from typer.testing import CliRunner

WriteBag = Callable[..., Path]


def no_such(path: Path, bag: Path) -> str:
    return "no such file or folder"


def empty_folder(path: Path, bag: Path) -> str:
    path.mkdir()
    return "expected a rosbag2 folder"


def other_file(path: Path, bag: Path) -> str:
    path.write_text("no recording")
    return "expected a rosbag2 folder"


def cut_mcap(path: Path, bag: Path) -> str:
    path.mkdir()
    (path / "bag.mcap").write_bytes((bag / "bag.mcap").read_bytes()[:50_000])
    return f"rabbit bag recover {path}"


def empty_mcap(path: Path, bag: Path) -> str:
    path.mkdir()
    shutil.copy(bag / "metadata.yaml", path)
    (path / "bag.mcap").write_bytes(b"")
    return str(path)


def noise_in_mcap(path: Path, bag: Path) -> str:
    path.mkdir()
    shutil.copy(bag / "metadata.yaml", path)
    (path / "bag.mcap").write_bytes(MCAP_MAGIC + bytes(range(256)) * 40 + MCAP_MAGIC)
    return str(path)


REFUSED_CUT = r"not finished|seems to be empty|magic is invalid|database: |missing tables"
BAD = (no_such, empty_folder, other_file, cut_mcap, empty_mcap, noise_in_mcap)


@pytest.mark.parametrize("spoil", BAD)
@pytest.mark.parametrize("command", ["info", pytest.param("plot", marks=DRAWS), "check"])
def test_refused_in_one_line(
    tmp_path: Path, write_bag: WriteBag, spoil: Callable[[Path, Path], str], command: str
) -> None:
    expected = spoil(tmp_path / "bad", write_bag(tmp_path / "bag"))
    done = CliRunner().invoke(app, [command, str(tmp_path / "bad")])
    assert done.exit_code == 2, done.output
    (line,) = done.stderr.splitlines()
    assert expected in line
    assert str(tmp_path / "bad") in line


@pytest.mark.parametrize("spoil", [no_such, empty_folder, other_file, empty_mcap])
def test_what_cannot_be_recovered_is_refused(
    tmp_path: Path, write_bag: WriteBag, spoil: Callable[[Path, Path], str]
) -> None:
    spoil(tmp_path / "bad", write_bag(tmp_path / "bag"))
    done = CliRunner().invoke(app, ["recover", str(tmp_path / "bad")])
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1), done.output
    assert not (tmp_path / "bad-recovered").exists()


def test_a_cut_database_is_refused(tmp_path: Path, write_bag: WriteBag) -> None:
    file = write_bag(tmp_path / "bag", "sqlite3") / "bag.db3"
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    done = CliRunner().invoke(app, ["info", str(tmp_path / "bag")])
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1), done.output
    assert "database: " in done.stderr


@pytest.mark.parametrize("storage", ["mcap", "sqlite3"])
def test_a_file_of_any_length_is_refused_with_sense(tmp_path: Path, write_bag: WriteBag, storage: str) -> None:
    bag = write_bag(tmp_path / "bag", storage, lambda topic, m: m if getattr(m, "tick", 0) < 4 else None)
    (file,) = (each for each in bag.iterdir() if each.suffix in (".mcap", ".db3"))
    whole, cut = file.read_bytes(), tmp_path / file.name
    for size in (*range(301), *random.Random(0).sample(range(301, len(whole)), 50)):
        cut.write_bytes(whole[:size])
        for read in (contents, read_episodes):
            with pytest.raises(RecordingError, match=REFUSED_CUT) as refused:
                read(cut)
            assert "\n" not in str(refused.value)
        if size % 25 < 9 or size > 300:
            try:
                shutil.rmtree(recover(cut, tmp_path / "recovered").path)
            except RecordingError as error:
                said = str(error)
                assert re.search(r"no whole message|expected a rosbag2 folder, or its \.mcap", said), (size, said)


@DRAWS
def test_other_message_definitions_are_refused(tmp_path: Path) -> None:
    """A recording of a version whose state had no `q`."""
    share = shutil.copytree(MESSAGES, tmp_path / "rabbit_msgs")
    (share / "msg" / "RobotState.msg").write_text("uint32 episode\nuint32 tick\nfloat64 angle\n")
    types = graph_types([share])
    writer = BagWriter(tmp_path / "bag", types)
    writer.add("/state", "rabbit_msgs/msg/RobotState", [])
    state = types.types["rabbit_msgs/msg/RobotState"](episode=1, tick=0, angle=0.0)
    writer.write("/state", 0, bytes(types.serialize_cdr(state, "rabbit_msgs/msg/RobotState")))
    writer.close()
    done = CliRunner().invoke(app, ["plot", str(tmp_path / "bag")])
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1), done.output
    assert "other message definitions" in done.stderr


def test_two_graphs_in_one_recording_are_refused(tmp_path: Path) -> None:
    writer = BagWriter(tmp_path / "bag", graph_types([MESSAGES]))
    for topic in ("/left/state", "/right/state"):
        writer.add(topic, "rabbit_msgs/msg/RobotState", [])
    writer.close()
    with pytest.raises(RecordingError, match="/left/state, /right/state"):
        read_episodes(tmp_path / "bag")


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    at=st.floats(0, 1, exclude_max=True),
    new=st.binary(min_size=1, max_size=12),
    storage=st.sampled_from(["mcap", "sqlite3"]),
)
def test_changed_bytes_raise_nothing_else(
    tmp_path_factory: pytest.TempPathFactory, write_bag: WriteBag, at: float, new: bytes, storage: str
) -> None:
    path = tmp_path_factory.mktemp("fuzz")
    bag = write_bag(path / "bag", storage, lambda topic, m: m if m.episode and getattr(m, "tick", 0) < 4 else None)
    (file,) = (each for each in bag.iterdir() if each.suffix in (".mcap", ".db3"))
    data = bytearray(file.read_bytes())
    begin = int(at * len(data))
    data[begin : begin + len(new)] = new
    file.write_bytes(data)
    for read in (contents, read_episodes, recover):
        with contextlib.suppress(RecordingError):
            read(bag)
    shutil.rmtree(path)


def test_a_block_of_zeros_anywhere_raises_nothing_else(tmp_path: Path, write_bag: WriteBag) -> None:
    """As a disk leaves it: some of them lie in the messages, whose index at the file's end stays sound."""
    (file,) = write_bag(tmp_path / "bag").glob("*.mcap")
    whole, refused = file.read_bytes(), 0
    for begin in range(0, len(whole), len(whole) // 60):
        file.write_bytes(whole[:begin] + bytes(64) + whole[begin + 64 :])
        try:
            contents(file.parent)
        except RecordingError:
            refused += 1
    assert refused > 1
