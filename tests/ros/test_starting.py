"""What a node, or a command that joins the graph, says of an environment or an argument that cannot be used."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

RABBIT = (sys.executable, "-c", "from rabbit_bringup.cli import app; app()")
RECORDER = ("run", "rabbit_recording", "recorder")


def last_line(*words: str, **environment: str | None) -> tuple[int, str]:
    """Exit code and last line of a command; an environment's name with None is left out."""
    merged = {**os.environ, **environment}
    kept = {name: value for name, value in merged.items() if value is not None}
    done = subprocess.run([*RABBIT, *words], capture_output=True, text=True, timeout=180, check=False, env=kept)
    assert "Traceback" not in done.stderr, done.stderr
    return done.returncode, done.stderr.splitlines()[-1]


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("-r", "foo"), "remap rule: '-r foo'"),
        (("--params-file", "/nowhere.yaml"), "/nowhere.yaml"),
        (("-p", "path"), "'-p path'"),
        (("--bogus",), "unknown ROS arguments ['--bogus']"),
        (("--log-level", "loud"), "--log-level loud"),
    ],
)
def test_a_node_refuses_a_wrong_argument_in_one_line(words: tuple[str, ...], said: str) -> None:
    code, line = last_line(*RECORDER, "--ros-args", *words)
    assert code == 2
    assert line.startswith("error: ")
    assert said in line
    assert "/src/" not in line  # where in ROS's sources


@pytest.mark.parametrize(
    "words", [RECORDER, ("view",), ("walk", "--out"), ("policy", "load", "rl-cbf-clf-qp")], ids=lambda words: words[0]
)
def test_a_domain_that_is_none_is_refused_by_all(words: tuple[str, ...], tmp_path: Path) -> None:
    if words[-1] == "--out":
        words = (*words, str(tmp_path / "walk"))
    code, line = last_line(*words, ROS_DOMAIN_ID="abc")
    assert code == 2
    assert line.endswith("ROS_DOMAIN_ID abc: expected a whole number from 0 to 232")
    assert not (tmp_path / "walk").exists()
