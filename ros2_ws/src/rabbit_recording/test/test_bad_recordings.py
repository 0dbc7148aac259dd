"""What is no recording is refused by each command in one line; what is damaged: `tests/fuzz`."""

import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from rabbit_recording.bag_writer import BagWriter, graph_types
from rabbit_recording.commands.bag import app
from recorded_walk import DRAWS, MESSAGES
from typer.testing import CliRunner

WriteBag = Callable[..., Path]


@pytest.mark.parametrize("command", ["info", pytest.param("plot", marks=DRAWS), "check"])
@pytest.mark.parametrize(("name", "said"), [("none", "no such file or folder"), (".", "expected a rosbag2 folder")])
def test_refused_in_one_line(tmp_path: Path, command: str, name: str, said: str) -> None:
    done = CliRunner().invoke(app, [command, str(tmp_path / name)])
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1), done.output
    assert said in done.stderr
    assert str(tmp_path / name) in done.stderr


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
