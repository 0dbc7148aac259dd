"""The tutorial on the ROS graph: the commands of its page, one after the other, on a shorter course."""

import json
import shlex
import subprocess
import sys
import time
from pathlib import Path

import pytest
from rl_cbf_clf_controller.weights import policy_path, read

PAGE = Path(__file__).parents[2] / "docs" / "tutorials" / "ros_graph.md"
RABBIT = (sys.executable, "-c", "from rabbit_bringup.cli import app; app()")
STONES = {"100": "40"}


def commands(out: Path) -> dict[str, list[str]]:
    """What the page tells a reader to type, by its first words; `out` in place of its folder."""
    typed = [
        line.split()[1:] for line in PAGE.read_text(encoding="utf-8").splitlines() if line.startswith("    rabbit ")
    ]
    words = [[STONES.get(word, word.replace("runs/swap", str(out))) for word in line] for line in typed]
    return {shlex.join(line[: 1 + (line[0] in ("bag", "policy"))]): line for line in words}


def rabbit(words: list[str], *more: str) -> str:
    """What a command prints; it must end well."""
    done = subprocess.run([*RABBIT, *words, *more], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.timeout(600)
def test_a_reader_walks_swaps_and_reads(tmp_path: Path) -> None:
    out = tmp_path / "swap"
    typed = commands(out)
    assert set(typed) == {
        "walk",
        "view",
        "policy load",
        "bag info",
        "bag check",
        "bag plot",
    }  # test_viewer has the view
    walk = subprocess.Popen([*RABBIT, *typed["walk"], "--no-pictures", "--no-video"])
    try:
        end = time.monotonic() + 180
        while not (out / "recording" / "recording.mcap").is_file() and time.monotonic() < end:
            time.sleep(0.05)
        rabbit(typed["policy load"], "--timeout", "120")
        assert walk.wait(timeout=300) == 0
    finally:
        walk.kill()
    told = json.loads(rabbit(typed["bag info"], "--json"))
    assert [episode["outcome"] for episode in told["episodes"]] == ["walked"]
    assert read(policy_path("rl-clf-qp")).version in json.dumps(told)
    rabbit(typed["bag check"])
    rabbit(typed["bag plot"])
    assert list(out.rglob("*.png"))
