"""A learned barrier of one's own: its tutorial's commands; then it is swapped, recorded and drawn like the paper's."""

import json
import re
import subprocess
import sys
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from rl_cbf_clf_controller.weights import read
from typed import environment, type_in

Rabbit = Callable[..., subprocess.CompletedProcess[str]]

NAME = "pitch-rl-clf-qp"
HEAVY = ("--terrain", "flat", "--mass-scale", "2", "--motor-lag", "0")
STEPS = 20  # of the tutorial's walks
SHORTER = {"rabbit walk": "--stones 3 --no-video --no-pictures"}
LIMIT, MARGIN = 0.345, 2e-4  # rad; the nominal robot leans 1e-3 to 3e-3 over the limit
READING = """
import json, pathlib, sys
from rabbit_recording.reader import iterate_episodes
print(json.dumps([
    (episode.outcome, tick.output.quantities, tick.output.policy_version, tick.state.q[2], tick.output.beta.tolist(),
     dict(zip(tick.output.barrier_names, tick.output.barriers.tolist())))
    for episode in iterate_episodes(pathlib.Path(sys.argv[1])) for tick in episode.records
]))
"""


@pytest.fixture
def rabbit(tmp_path: Path) -> Rabbit:
    """The command `rabbit` where the tutorial has installed the example."""

    def run(*words: object, program: str = "rabbit") -> subprocess.CompletedProcess[str]:
        command = [program, *map(str, words)]
        env = environment(tmp_path)
        return subprocess.run(command, capture_output=True, text=True, timeout=900, check=False, env=env)

    return run


@pytest.mark.timeout(1500)
def test_a_barrier_of_ones_own_is_learned_like_the_papers(rabbit: Rabbit, tmp_path: Path) -> None:
    """At twice the mass the nominal robot falls; with learned estimates it walks and never leans over the limit."""
    said = type_in("docs/tutorials/own_barrier.md", tmp_path, SHORTER)
    assert "walked: 1 of 1 episodes walked" in said
    policy = Path("runs/pitch/policy.safetensors")
    leans = re.findall(r"^(\S+), seed \d+: (\d+) steps, lean up to (\S+) rad", said, re.MULTILINE)
    steps = {name: [int(each[1]) for each in leans if each[0] == name] for name in ("zero", str(policy))}
    assert max(steps["zero"]) < STEPS == min(steps[str(policy)])
    assert all(float(lean) < LIMIT + MARGIN for name, _, lean in leans if name == str(policy))

    recording = walk_and_swap(rabbit, tmp_path / "walk", tmp_path / policy)
    done = rabbit("-c", READING, recording, program=sys.executable)
    ticks = json.loads(done.stdout or "[]")
    assert ticks, done.stderr
    outcomes, quantities, versions, lean, beta, barriers = zip(*ticks, strict=True)
    assert set(outcomes) == {"walked"}
    assert set(map(tuple, quantities)) == {("V", "pitch")}
    assert len(set(versions)) == len((BEFORE, policy))
    assert max(lean) < LIMIT + MARGIN
    assert [each["pitch"] for each in barriers] == pytest.approx([LIMIT - each for each in lean])
    last = read(tmp_path / policy).version
    learned = [each for each, version in zip(beta, versions, strict=True) if version == last]
    assert all(any(column) for column in zip(*learned, strict=True))

    done = rabbit("bag", "check", recording)
    assert (done.returncode, "torques identical" in done.stdout) == (0, True), done.stdout + done.stderr
    done = rabbit("bag", "plot", recording, "--out", tmp_path / "pictures")
    for name in ("quantities", "barriers"):
        assert (tmp_path / "pictures" / f"{name}.png").is_file(), done.stderr


UNDER_WAY = 300_000  # bytes of a recording
BEFORE = -2  # the policy of the last but one episode of the training


def walk_and_swap(rabbit: Rabbit, folder: Path, policy: Path) -> Path:
    """A walk with the policy of the last but one episode, in which the last one is loaded; returns its recording."""
    earlier = sorted((policy.parent / "policies").glob("*.safetensors"))[BEFORE]
    walk = ("--controller", NAME, *HEAVY, "--stones", 8, "--episodes", 8, "--seed", 9, "--pace", 1, "--no-trainer")
    with ThreadPoolExecutor() as pool:
        walking = pool.submit(rabbit, "walk", *walk, "--policy", earlier, "--out", folder)
        while not walking.done() and sum(file.stat().st_size for file in folder.glob("recording/*.mcap")) < UNDER_WAY:
            time.sleep(0.1)
        loaded = rabbit("policy", "load", policy, "--timeout", 120)
        done = walking.result()
    assert loaded.returncode == 0, loaded.stdout + loaded.stderr
    assert done.returncode == 0, done.stdout + done.stderr
    return folder / "recording"
