"""`rabbit walk` and `rabbit run` as a person uses them: exit codes, what they leave, and nobody left running."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import yaml
from rabbit_bringup.recording.reader import messages, read_episodes
from rl_cbf_clf_controller.weights import decode, policy_path
from rl_trainer.parameters import TrainingParameters
from rl_trainer.training import Trainer

RABBIT = (sys.executable, "-c", "from rabbit_bringup.cli import app; app()")
QUICK = ("--no-pictures", "--no-video")
SLOW = ("--pace", "0.5", "--stones", "200")


def rabbit(*words: object, timeout: float = 300.0) -> subprocess.CompletedProcess[str]:
    """Call the command and wait."""
    return subprocess.run([*RABBIT, *map(str, words)], capture_output=True, text=True, timeout=timeout, check=False)


def running(folder: Path) -> dict[str, int]:
    """Node processes whose parameters lie in a folder, by node."""
    found = {}
    for process in Path("/proc").glob("[0-9]*"):
        try:
            command = (process / "cmdline").read_bytes().split(b"\0")
        except OSError:
            continue
        if str(folder / "parameters.yaml").encode() in command:
            name = next(n for n in ("simulator", "controller", "trainer", "recorder") if n in str(command))
            found[name] = int(process.name)
    return found


def wait_for(holds: Callable[[], bool], seconds: float = 180.0) -> None:
    """Until something holds."""
    end = time.monotonic() + seconds
    while not holds():
        assert time.monotonic() < end
        time.sleep(0.05)


@pytest.fixture
def walking(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    """A slow walk with all nodes, that has begun; its folder is `tmp_path`."""
    command = [*RABBIT, "walk", "--out", str(tmp_path), *QUICK, *SLOW]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    wait_for(lambda: len(running(tmp_path)) == 4)
    wait_for(lambda: (tmp_path / "recording" / "recording.mcap").is_file())
    first = policy_path("rl-cbf-clf-qp").stat().st_size  # what is recorded before the first tick
    wait_for(lambda: (tmp_path / "recording" / "recording.mcap").stat().st_size > first + 150_000)
    yield process
    process.kill()
    process.wait()


def test_a_walk_leaves_its_folder(tmp_path: Path) -> None:
    done = rabbit("walk", "--out", tmp_path, "--stones", 2, "--seed", 4)
    assert done.returncode == 0, done.stdout + done.stderr
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["walked"], summary["episodes"][0]["stones"], summary["episodes"][0]["seed"]) == (True, 2, 4)
    assert summary["episodes"][0]["ticks_not_recorded"] == 0
    assert len(read_episodes(tmp_path / "recording")[1].records) == summary["ticks"]
    assert {path.name for path in tmp_path.iterdir()} >= {
        "parameters.yaml",
        "records.npz",
        "log",
        "walk.mp4",
        "walk.gif",
    }
    assert len(list((tmp_path / "pictures").glob("*.png"))) == 6
    assert not running(tmp_path)


def test_the_trainer_learns_on_from_the_policy_that_walks(tmp_path: Path) -> None:
    """An untrained policy is nearly the zero one; the form of this one is not the default."""
    form = TrainingParameters(hidden1=20, hidden2=16, structured=False, observe_l_min=False)
    file, folder = Trainer(form).policy_file(), tmp_path / "walk"
    file.write(tmp_path / "policy.safetensors")
    learned = ("--controller", "rl-cbf-clf-qp", "--policy", tmp_path / "policy.safetensors")
    slow = ("--mass-scale", 1.1, "--stones", 12, "--pace", 0.5)  # time to learn on a busy machine
    done = rabbit("walk", "--out", folder, *learned, *slow, *QUICK)
    assert done.returncode == 0, done.stdout + done.stderr
    told = yaml.safe_load((folder / "parameters.yaml").read_text())
    assert told["/**/controller"]["ros__parameters"]["swap_at"] == "tick"
    walked = read_episodes(folder / "recording")[1]
    assert walked.swaps[0].version == file.version
    published = {m.version: bytes(m.data) for _, m in messages(folder / "recording", "policy")}
    for swap in walked.swaps[1:]:
        assert published[swap.version] == swap.data
        assert f"from {file.version}" in decode(swap.data).metadata.command
    assert published or "kept back" in (folder / "log" / "trainer.log").read_text()


def test_a_fall_is_exit_code_1(tmp_path: Path) -> None:
    heavy = ("--controller", "cbf-clf-qp", "--mass-scale", 2)
    done = rabbit("walk", "--out", tmp_path, *heavy, "--no-trainer", "--record", "none")
    assert done.returncode == 1
    assert "20 stones" in done.stdout
    assert not running(tmp_path)


@pytest.mark.parametrize("signals", [(signal.SIGINT,), (signal.SIGINT, signal.SIGINT), (signal.SIGTERM,)])
def test_signals_end_all(walking: subprocess.Popen[str], tmp_path: Path, signals: tuple[int, ...]) -> None:
    for number in signals:
        walking.send_signal(number)
        time.sleep(0.3)
    _, said = walking.communicate(timeout=300)
    assert walking.returncode == 128 + signals[0]
    assert "stopped by" in said
    assert "Traceback" not in said
    assert not running(tmp_path)
    if len(signals) == 1:
        assert read_episodes(tmp_path / "recording")[1].records


def test_a_killed_launcher_leaves_nobody_behind(walking: subprocess.Popen[str], tmp_path: Path) -> None:
    walking.kill()
    wait_for(lambda: not running(tmp_path), 30.0)


def test_a_node_that_dies_ends_the_walk_and_is_named(walking: subprocess.Popen[str], tmp_path: Path) -> None:
    os.kill(running(tmp_path)["controller"], signal.SIGKILL)
    _, said = walking.communicate(timeout=300)
    assert walking.returncode == 1
    assert "the controller ended by itself (signal SIGKILL)" in said
    assert not running(tmp_path)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--mass-scale", "99"), "--mass-scale 99"),
        (("--policy", "oracle"), "--policy oracle"),
        (("--policy", "nowhere"), "nowhere"),
        (("--record", "vhs"), "--record vhs"),
        (("--namespace", "a b"), "--namespace a b"),
        (("--training", "/nowhere.yaml"), "/nowhere.yaml"),
        (("--out", "/proc"), "--out /proc"),
    ],
)
def test_bad_values_are_one_line_and_exit_code_2(tmp_path: Path, words: tuple[str, ...], said: str) -> None:
    done = rabbit("walk", *(() if "--out" in words else ("--out", str(tmp_path))), *words)
    assert done.returncode == 2, done.stdout + done.stderr
    (line,) = done.stderr.splitlines()
    assert said in line


def test_run_finds_executables_as_ros2_run_does() -> None:
    done = rabbit("run", "rabbit_sim", "simulator", "--ros-args", "-p", "mass_scale:=99.0")
    assert done.returncode == 2
    assert "mass_scale" in done.stderr
    assert "it has: simulator" in rabbit("run", "rabbit_sim", "nobody").stderr
    assert "package nowhere" in rabbit("run", "nowhere", "nobody").stderr
