"""Whatever is handed over as a recording: it is read, or refused in one line with exit code 2."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from rabbit_recording.bag_writer import BagWriter, graph_types
from rabbit_recording.commands.bag import app
from rabbit_recording.open_recording import MCAP_MAGIC
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
