"""The other commands that need no ROS: train, policy, bench, video, gait."""

import json
import sys
from pathlib import Path

import pytest
from rabbit_command import invoke
from rl_cbf_clf_controller.weights import read

ALONE = ("--second", "none", "--stones", 1)
SHORT = ("--episodes", 2, "--nominal-episodes", 1, "--walking-steps", 1, "--updates-least", 3, "--updates-per-tick", 0)


def test_training_leaves_a_sound_policy_and_goes_on(tmp_path: Path) -> None:
    done = invoke("train", "--out", tmp_path, "--problem", "rl-clf-qp", "--batch", 8, *SHORT)
    assert done.exit_code == 0, done.output
    first = read(tmp_path / "policy.safetensors")
    plant = first.metadata.plant
    assert first.metadata.episodes == 2
    assert (plant["mass_scale"], plant["motor_lag"], plant["stop_at_miss"]) == (2, 0, False)
    assert invoke("policy", "verify", tmp_path / "policy.safetensors").exit_code == 0
    assert first.content_hash in invoke("policy", "show", tmp_path / "policy.safetensors").output
    errors = ("estimates", tmp_path / "policy.safetensors", "--runs", 1, "--stones", 1, "--payload", 5)
    assert invoke(*errors, "--out", tmp_path / "errors.json").exit_code == 0
    found = json.loads((tmp_path / "errors.json").read_text())
    used = found["parameters"]["simulation"]
    assert (used["mass_scale"], used["payload"], used["motor_lag"], used["terrain"]) == (2, 5, 0.004, "flat")
    assert found["policy_version"] == first.version
    assert found["on_walks_of"]["policy"]["quantities"].keys() == {"V", "V_unscaled"}
    assert len(found["on_walks_of"]["oracle"]["walks"]) == 1
    again = invoke("train", "--out", tmp_path, "--problem", "rl-clf-qp", "--batch", 8, *SHORT[2:], "--episodes", 3)
    assert again.exit_code == 0, again.output
    assert "episode   3" in again.output
    assert "episode   2" not in again.output
    assert read(tmp_path / "policy.safetensors").metadata.episodes == 3


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("evaluate", "--runs", "ten"), "--runs ten: expected integer"),
        (("evaluate", "--mass-scale", 50), "--mass-scale 50: expected less than or equal to 10"),
        (("evaluate", "--controller", "pid"), "--controller pid: expected one of cbf-clf-qp, clf-qp,"),
        (("evaluate", "--parameters", "nowhere.yaml"), "nowhere.yaml"),
        (("gait", "--step-length", 0.9, "--name", "x"), "--step-length 0.9: expected less than or equal to 0.7"),
        (("gait", "--name", "x", "--library", "0.4,0.3"), "--library: lengths = [0.4, 0.3]: expected"),
        (("policy", "verify", "nowhere"), "nowhere"),
        (("estimates", "nowhere", "--runs", 0), "--runs 0"),
        (("bench", "--policy", "nobody"), "--policy nobody"),
        (("play", "--policy", "nowhere"), "--policy nowhere: expected one of zero, oracle"),
        (("play", "--terrain", "flat", "--first", "learned", "--export", "x"), "--terrain flat: expected stones"),
        (("play", *ALONE, "--export", "/nowhere/walk.html"), "--export /nowhere/walk.html: No such file"),
    ],
)
def test_a_bad_value_ends_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[object, ...], told: str
) -> None:
    monkeypatch.chdir(tmp_path)
    done = invoke(*words)
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert told in done.stderr


def test_loading_a_policy_without_ros_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rabbit_common.ros.client", None)  # as if it could not be imported
    refused = invoke("policy", "load", "zero")
    assert (refused.exit_code, refused.stderr.count("\n")) == (1, 1)
    assert "source ros2_ws/install/setup.bash" in refused.stderr
