"""`rabbit evaluate`, `train`, `policy` as a user calls them: files, resumption, one line for what is wrong."""

import csv
import json
import sys
from pathlib import Path

import numpy as np
import pytest
from rabbit_command import invoke
from rl_cbf_clf_controller.uncertainty import RL_CBF_CLF_QP
from rl_cbf_clf_controller.weights import read
from typer.testing import Result
from untrained_policy import policy_file, policy_metadata

KEYS = (
    *("runs", "stones", "success_rate", "success_with_forces", "success_rate_ci95", "mean_stones", "std_stones"),
    *("missed_stones", "falls", "max_force_ratio", "ticks_over_cone", "ticks_over_cone_at_impact"),
    *("qp_unanswered_ticks", "slack_ticks", "tick_ms_p50", "tick_ms_p99", "real_time_factor"),
    *("command", "versions", "parameters", "ecbf_start_violations", "rescue_ticks", "active_share"),
)


def evaluate(out: Path, *words: object) -> Result:
    """Short runs in this process."""
    return invoke("evaluate", "--out", out, "--jobs", 1, "--stones", 1, *words)


def rows(out: Path) -> list[dict[str, str]]:
    """Of runs.csv."""
    with (out / "runs.csv").open() as file:
        return list(csv.DictReader(file))


def test_a_batch_leaves_the_same_rows(tmp_path: Path) -> None:
    words = "--runs", 3, "--controller", "cbf-clf-qp", "--plant", "mujoco", "--qp-solver", "daqp"
    for name, batch in (("alone", 1), ("batch", 2)):
        done = evaluate(tmp_path / name, *words, "--batch", batch)
        assert done.exit_code == 0, done.output
    times = {"tick_ms_p50", "tick_ms_p99", "plant_ms_p50", "walk_seconds"}
    for one, other in zip(rows(tmp_path / "alone"), rows(tmp_path / "batch"), strict=True):
        assert {name for name in one if one[name] != other[name]} <= times


def test_files_of_an_evaluation(tmp_path: Path) -> None:
    done = evaluate(tmp_path, "--runs", 2, "--mass-scale", 1.1, "--eps", 0.06, "--no-force-rows", "--torque-limit", 150)
    assert done.exit_code == 0, done.output
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert set(KEYS) <= summary.keys()
    assert summary["runs"] == len(rows(tmp_path)) == 2
    used = summary["parameters"]
    assert (used["simulation"]["mass_scale"], used["simulation"]["motor_lag"]) == (1.1, 0.004)
    assert (used["controller"]["eps"], used["controller"]["force_rows"]) == (0.06, False)
    assert used["controller"]["torque_limit"] == used["simulation"]["torque_limit"] == 150
    assert summary["success_rate_ci95"][0] <= summary["success_rate"] <= summary["success_rate_ci95"][1]


def test_runs_that_are_done_are_not_run_again(tmp_path: Path) -> None:
    assert evaluate(tmp_path, "--runs", 1).exit_code == 0
    first = rows(tmp_path)
    more = evaluate(tmp_path, "--runs", 3)
    assert more.exit_code == 0
    assert "2 runs made" in more.output
    assert rows(tmp_path)[:1] == first  # its wall times too
    assert len(rows(tmp_path)) == 3
    assert evaluate(tmp_path, "--runs", 1, "--seed", 2).exit_code == 0
    (other,) = rows(tmp_path)
    assert other["seed"] != first[0]["seed"]
    assert "0 runs made" in evaluate(tmp_path, "--runs", 1).output
    assert rows(tmp_path) == first


def test_a_policy_file_of_zeros_is_the_nominal_controller(tmp_path: Path) -> None:
    policy_file(policy_metadata(RL_CBF_CLF_QP), np.zeros).write(file := tmp_path / "zeros.safetensors")
    assert evaluate(tmp_path / "zeros", "--controller", "rl-cbf-clf-qp", "--policy", file, "--runs", 1).exit_code == 0
    assert evaluate(tmp_path / "nominal", "--runs", 1).exit_code == 0
    learned, nominal = (rows(tmp_path / name)[0] for name in ("zeros", "nominal"))
    assert learned["max_clf"] == nominal["max_clf"]
    assert learned["ticks"] == nominal["ticks"]


ALONE = ("--second", "none", "--stones", 1)
CART = ("--task", "cart.py")
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
        (("evaluate", "--batch", 0), "--batch 0: expected"),
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
        (("play", "--no-browser", "--course", "nosuch.yaml"), "course nosuch.yaml"),
        (("evaluate", "--task", "nosuch.py"), "nosuch.py: no such file"),
        (("benchmark", *CART, "--controller", "nosuch"), "nosuch"),
        (("evaluate", *CART, "--controller", "nosuch"), "nosuch"),
        (("evaluate", *CART, "--controller", "nosuch.safetensors"), "nosuch.safetensors"),
        (("evaluate", *CART, "--rides", 1, "--out", "/proc/nosuch"), "/proc/nosuch"),
        (("train", "--paper-literal", "--learner", "ddpg"), "failure_penalty > 0: expected learner = paper_ddpg; ddpg"),
        (("train", "--paper-literal", "--failure-penalty", -1), "--failure-penalty -1: expected"),
        (("train", *CART, "--learner", "nosuch"), "--learner nosuch"),
        (("train", *CART, "--out", "/proc/nosuch/p.safetensors"), "/proc/nosuch"),
        (("train", *CART, "--out", "policy.txt"), "policy.txt"),
        (("bag", "check", "nosuch", *CART), "nosuch"),
    ],
)
@pytest.mark.usefixtures("cart")
def test_a_bad_value_ends_in_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, words: tuple[object, ...], told: str
) -> None:
    monkeypatch.chdir(tmp_path)
    done = invoke(*words)
    assert (done.exit_code, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert told in done.stderr


def test_loading_a_policy_without_ros_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "rabbit_common.ros.client", None)  # as if it could not be imported
    refused = invoke("policy", "load", "zero")
    assert (refused.exit_code, refused.stderr.count("\n")) == (1, 1)
    assert "source ros2_ws/install/setup.bash" in refused.stderr
