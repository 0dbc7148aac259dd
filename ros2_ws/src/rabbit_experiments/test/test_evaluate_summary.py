"""Intervals with known ends, summaries of hand-made rows, and a results folder that goes on where it stopped."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rabbit_experiments.metrics import RunResult, RunRow
from rabbit_experiments.results import ResultsError, ResultsFolder
from rabbit_experiments.summary import mean_interval, summarise, wilson


def result(run: int, **changes: Any) -> RunResult:
    """A run in which nothing happened, but for `changes`."""
    values: dict[str, Any] = dict.fromkeys(RunRow.model_fields, 0)
    values |= {"run": run, "outcome": "walked", "success": True, "success_with_forces": True, "stones": 20}
    values |= {"ticks": 4, "steps": 2, "walk_seconds": 0.01, "least_barriers": {}, **changes}
    return RunResult(row=RunRow.model_validate(values), violations=[], tick_seconds=[0.002] * 4)


@pytest.mark.parametrize(("successes", "runs"), [(0, 10), (5, 10), (49, 50), (50, 50)])
def test_wilson_interval_solves_its_equation(successes: int, runs: int) -> None:
    z = 1.959963984540054
    for end in wilson(successes, runs):
        share = successes / runs
        assert (share - end) ** 2 == pytest.approx(z**2 * end * (1 - end) / runs, abs=1e-12)


def test_interval_of_the_mean_of_two_values() -> None:
    low, high = mean_interval(np.array([1.0, 3.0])) or (math.nan, math.nan)
    half = math.tan(math.pi * 0.475)  # Student's t of one degree of freedom is Cauchy's; standard error 1
    assert [low, high] == pytest.approx([2 - half, 2 + half])
    assert mean_interval(np.array([4.0])) is None


@pytest.mark.parametrize("runs", [2, 3, 5, 20])
def test_the_mean_of_counts_lies_where_a_mean_of_them_can(runs: int) -> None:
    """Of 0 to 20 stones, most runs at the end: the interval is cut, and misses the true mean no more often."""
    rng, cut = np.random.default_rng(4), 0
    for _ in range(200):
        stones = np.where(rng.random(runs) < 0.6, 20, rng.integers(0, 21, runs)).astype(float)  # 16 in the mean
        low, high = mean_interval(stones, 0, 20) or (math.nan, math.nan)
        whole = mean_interval(stones) or (math.nan, math.nan)
        assert 0 <= low <= stones.mean() <= high <= 20
        assert (low <= 16 <= high) == (whole[0] <= 16 <= whole[1])
        cut += (low, high) != whole
    assert cut > 10


def test_summary_counts() -> None:
    runs = [
        result(0),
        result(1, success_with_forces=False, ticks_over_cone=3, max_force_ratio=0.9),
        result(2, success=False, success_with_forces=False, outcome="gap_fall", stones=5, missed_stones=1),
        result(3, success=False, success_with_forces=False, outcome="fall", stones=7, qp_unanswered_ticks=1),
    ]
    summary = summarise(runs, "osqp")
    assert (summary["success_rate"], summary["success_with_forces"]) == (0.5, 0.25)
    assert summary["falls"] == {"gap_fall": 1, "fall": 1}
    assert (summary["mean_stones"], summary["missed_stones"]) == (13.0, 1)
    assert (summary["ticks_over_cone"], summary["max_force_ratio"]) == (3, 0.9)
    assert summary["qp_solver_share"] == 15 / 16
    assert summary["tick_ms_p50"] == pytest.approx(2.0)
    assert summary["real_time_factor"] == pytest.approx(4.0)
    json.dumps(summary, allow_nan=False)


def test_rms_is_over_all_ticks_not_over_runs() -> None:
    summary = summarise([result(0, rms_y=0.3, ticks=1), result(1, rms_y=0.1, ticks=9)], "osqp")
    assert summary["rms_y"] == pytest.approx(math.sqrt(0.018))


def test_a_folder_of_another_evaluation_is_refused(tmp_path: Path) -> None:
    first = ResultsFolder(tmp_path, {"key": "a", "made_with": {}})
    first.cache.path.mkdir()
    with pytest.raises(ResultsError, match="another evaluation"):
        ResultsFolder(tmp_path, {"key": "b", "made_with": {}})
    assert first.cache.path.exists()
    ResultsFolder(tmp_path, {"key": "b", "made_with": {}}, overwrite=True)
    assert not first.cache.path.exists()
