"""`rabbit walk` and `rabbit run` as a person uses them, and the services of compose.yaml without Docker."""

import json
import os
import re
import shlex
import signal
import subprocess
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from rabbit_command import RABBIT, rabbit
from rabbit_common.exit_codes import ExitCode
from rabbit_msgs.srv import ResetEpisode
from rabbit_recording.reader import iterate_episodes, messages
from recorded_walk import read_episodes
from rl_cbf_clf_controller.weights import decode, policy_path
from rl_trainer.parameters import TrainingParameters
from rl_trainer.training import Trainer

QUICK = ("--no-pictures", "--no-video")
SLOW = ("--pace", "0.5", "--stones", "200", "--ready-timeout", "180")
SMALL = ("--stones", "1", "--no-trainer", "--no-record", "--ready-timeout", "180")


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
    """A slow walk of all four nodes in `tmp_path`, that has begun: more is recorded than before its first tick."""
    before, recording = policy_path("rl-cbf-clf-qp").stat().st_size, tmp_path / "recording" / "recording.mcap"
    command = [*RABBIT, "walk", "--out", str(tmp_path), *QUICK, *SLOW]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    wait_for(lambda: recording.is_file() and recording.stat().st_size > before + 100_000)
    assert len(running(tmp_path)) == 4
    yield process
    process.kill()
    process.wait()
    wait_for(lambda: not running(tmp_path))  # the next walk may be in the same namespace


def test_a_walk_leaves_its_folder(tmp_path: Path) -> None:
    done = rabbit("walk", "--out", tmp_path, "--stones", 2, "--seed", 4, "--no-trainer")
    assert done.returncode == 0, done.stdout + done.stderr
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["walked"], summary["episodes"][0]["stones"], summary["episodes"][0]["seed"]) == (True, 2, 4)
    assert summary["episodes"][0]["ticks_not_recorded"] == 0
    assert len(read_episodes(tmp_path / "recording")[1].records) == summary["ticks"]
    left = {path.name for path in tmp_path.iterdir()}
    assert left >= {"parameters.yaml", "records.npz", "log", "walk.mp4", "walk.gif"}
    assert len(list((tmp_path / "pictures").glob("*.png"))) == 4
    assert not running(tmp_path)


def test_the_trainer_learns_on_from_the_policy_that_walks(tmp_path: Path) -> None:
    """An untrained policy is nearly the zero one; the form of this one is not the default."""
    form = TrainingParameters(hidden1=20, hidden2=16, structured=False, observe_l_min=False)
    trainer, folder = Trainer(form), tmp_path / "walk"
    trainer.episode = form.nominal_episodes  # the next ones are walked with the policy
    file = trainer.policy_file()
    file.write(tmp_path / "policy.safetensors")
    learned = ("--controller", "rl-cbf-clf-qp", "--policy", tmp_path / "policy.safetensors")
    few = ("--mass-scale", 1.1, "--stones", 2, "--episodes", 2, "--swap-at", "episode")
    done = rabbit("walk", "--out", folder, *learned, *few, *QUICK)
    assert done.returncode in (ExitCode.WALKED, ExitCode.FELL), done.stdout + done.stderr
    told = yaml.safe_load((folder / "parameters.yaml").read_text())
    assert told["/**/controller"]["ros__parameters"]["swap_at"] == "episode"
    swaps = [swap for episode in read_episodes(folder / "recording").values() for swap in episode.swaps]
    published = {m.version: bytes(m.data) for _, m in messages(folder / "recording", "policy")}
    assert len(swaps) == 2
    for swap in swaps:
        assert published[swap.version] == swap.data
        assert f"from {file.version}" in decode(swap.data).metadata.command


def test_a_fall_has_an_exit_code_of_its_own(tmp_path: Path) -> None:
    heavy = ("--controller", "cbf-clf-qp", "--mass-scale", 2)
    done = rabbit("walk", "--out", tmp_path, *heavy, "--no-trainer", "--no-record")
    assert done.returncode == ExitCode.FELL
    assert "20 stones" in done.stdout
    assert done.stdout.splitlines()[-1] == "fell: 0 of 1 episodes walked"
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
    (line,) = said.splitlines()
    assert walking.returncode == ExitCode.NODE_DIED
    assert "the controller ended by itself (signal SIGKILL)" in line
    assert f"what was recorded until then: {tmp_path / 'recording'}" in line
    assert not running(tmp_path)
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert (summary["walked"], summary["exit_code"]) == (False, ExitCode.NODE_DIED)
    assert "controller" in summary["failure"]
    assert summary["ticks"] == len(read_episodes(tmp_path / "recording")[1].records) > 0


def test_an_episode_that_an_operator_asks_for_is_walked_to_its_end(tmp_path: Path, root_world: Any) -> None:
    slow = ("--pace", "1", "--stones", "3", "--no-trainer", "--no-record")
    process = subprocess.Popen([*RABBIT, "walk", "--out", tmp_path / "walk", *slow], stdout=subprocess.PIPE, text=True)
    states = root_world.hear("state")
    root_world.wait(lambda: any(state.tick > 20 for state in states))
    assert root_world.ask(ResetEpisode, "reset_episode", seed=7).success
    out, _ = process.communicate(timeout=300)
    lines = [line for line in out.splitlines() if line.startswith("episode ")]
    assert [line.split(",")[0] for line in lines] == ["episode 1", "episode 2"]
    assert "reset (by service)" in lines[0]
    assert "seed 7: walked, 3 of 3 stones" in lines[1]
    assert process.returncode == ExitCode.WALKED


def test_a_second_walk_in_one_namespace_is_refused(walking: subprocess.Popen[str], tmp_path: Path) -> None:
    second = rabbit("walk", "--out", tmp_path / "second", "--stones", 1)
    (line,) = second.stderr.splitlines()
    assert second.returncode == ExitCode.REFUSED
    assert "namespace / of ROS domain" in line
    assert "--namespace" in line
    assert not (tmp_path / "second").exists()
    assert len(running(tmp_path)) == 4
    other = rabbit("walk", "--out", tmp_path / "other", "--namespace", "other", *SMALL)
    assert other.returncode == ExitCode.WALKED, other.stderr
    assert len(running(tmp_path)) == 4
    assert walking.poll() is None


def test_nodes_walk_again_under_the_parameters_that_a_walk_has_left(tmp_path: Path, world: Any) -> None:
    """Without a launcher: nobody lets the simulator begin, and it does not take the first walk for its own."""
    folder = tmp_path / "walk"
    words = (*QUICK, "--no-trainer", "--stones", 2, "--ready-timeout", 180, "--controller", "cbf-clf-qp")
    done = rabbit("walk", *words, "--out", folder)
    assert done.returncode == ExitCode.WALKED, done.stderr
    before = [record.output.torque for record in read_episodes(folder / "recording")[1].records]
    torques, episodes = world.hear("torque"), world.hear("episode")
    for name in ("controller", "simulator"):
        world.processes.start(name, (*world.space, "--params-file", str(folder / "parameters.yaml")))
    world.wait(lambda: bool(episodes) and episodes[-1].outcome == "walked")
    world.wait(lambda: len({message.tick for message in torques}) == len(before))
    by_tick = {message.tick: message.torque for message in torques}
    np.testing.assert_array_equal([by_tick[tick] for tick in sorted(by_tick)], before)


ROOT = Path(__file__).resolve().parents[2]
CHANGED = {"port 8765": "port 0", "0.0.0.0": "127.0.0.1", "pace:=1.0": "pace:=0.0"}
MEMORY = "/dev/shm"  # of `ground`
SERVICES = ("simulator", "controller", "trainer", "recorder", "viewer")


@pytest.fixture
def start(tmp_path: Path) -> Iterator[Callable[[str], subprocess.Popen[bytes]]]:
    """Starts a service's command in one folder; two short episodes are walked."""
    text = re.sub(r"\$\{\w+:-([^}]*)\}", r"\1", (ROOT / "docker" / "compose.yaml").read_text(encoding="utf-8"))
    for word, other in {**CHANGED, MEMORY: str(tmp_path / "memory")}.items():
        assert word in text
        text = text.replace(word, other)
    services, running = yaml.safe_load(text)["services"], list[subprocess.Popen[bytes]]()

    def begin(name: str) -> subprocess.Popen[bytes]:
        command = services[name]["command"] + " -p stones:=3 -p episodes:=2" * (name == "simulator")
        running.append(subprocess.Popen(shlex.split(command), cwd=tmp_path, env={**os.environ, "OMP_NUM_THREADS": "1"}))
        return running[-1]

    yield begin
    for process in running:
        process.kill()
        process.wait()


def test_services_walk_and_record(start: Any, root_world: Any, tmp_path: Path) -> None:
    """The simulator is killed in the first episode and started again, as its restart policy would."""
    torques = root_world.hear("torque")
    running = {name: start(name) for name in SERVICES}
    root_world.wait(lambda: len(torques) > 20)
    running["simulator"].kill()
    running["simulator"] = start("simulator")
    root_world.ended(2)
    for process in running.values():
        process.send_signal(signal.SIGTERM)
    assert [process.wait(180) for process in running.values()] == [0] * len(SERVICES)
    (recording,) = tmp_path.glob("recording-*")
    broken, whole = iterate_episodes(recording)
    assert (broken.number, broken.outcome) == (1, "reset")
    assert (whole.number, whole.outcome) == (2, "walked")
    assert whole.last - whole.first + 1 == whole.recorded + whole.lost
    assert list((tmp_path / "training").iterdir())
