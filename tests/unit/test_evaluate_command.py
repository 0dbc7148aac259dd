"""`rabbit evaluate` as a user calls it: files, resumption, and one line with exit code 2 for what is wrong."""

import csv
import json
from pathlib import Path

import numpy as np
from rabbit_command import invoke
from rl_cbf_clf_controller.uncertainty import RL_CBF_CLF_QP
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


def zero_policy_file(path: Path) -> Path:
    """An actor for stepping stones whose outputs are all zero."""
    policy_file(policy_metadata(RL_CBF_CLF_QP), np.zeros).write(path)
    return path


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
    refused = evaluate(tmp_path / "refused", "--batch", 0)
    assert refused.exit_code == 2
    assert "--batch" in refused.output


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
    refused = evaluate(tmp_path, "--runs", 3, "--seed", 2)
    assert refused.exit_code == 2
    assert "another evaluation" in refused.stderr
    assert evaluate(tmp_path, "--runs", 1, "--seed", 2, "--overwrite").exit_code == 0
    assert rows(tmp_path)[0]["seed"] != first[0]["seed"]


def test_a_policy_file_of_zeros_is_the_nominal_controller(tmp_path: Path) -> None:
    file = zero_policy_file(tmp_path / "zeros.safetensors")
    assert evaluate(tmp_path / "zeros", "--controller", "rl-cbf-clf-qp", "--policy", file, "--runs", 1).exit_code == 0
    assert evaluate(tmp_path / "nominal", "--runs", 1).exit_code == 0
    learned, nominal = (rows(tmp_path / name)[0] for name in ("zeros", "nominal"))
    assert learned["max_clf"] == nominal["max_clf"]
    assert learned["ticks"] == nominal["ticks"]
