"""From rows to a summary: rates with Wilson's interval, means with Student's, counts and times."""

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rabbit_description.state import TICK_SECONDS
from scipy import stats

from rabbit_experiments.metrics import ROWS, RunResult, RunRow

SUMMED = (
    "missed_stones",
    "ticks_over_cone",
    "ticks_over_cone_at_impact",
    "ticks_normal_force_negative",
    "ticks_lost",
    "ticks_lost_at_impact",
    "qp_unanswered_ticks",
    "qp_unconstrained_ticks",
    "slack_ticks",
    "rescue_ticks",
    "saturated_ticks",
    "ecbf_start_violations",
)
ENDED_WELL = "walked"


def summarise(results: Sequence[RunResult], qp_solver: str) -> dict[str, Any]:
    """The figures of summary.json."""
    rows = [result.row for result in results]
    ticks = sum(row.ticks for row in rows)
    stones = np.array([row.stones for row in rows], dtype=float)
    summed = {name: sum(getattr(row, name) for row in rows) for name in SUMMED}
    return {
        "runs": len(rows),
        "success_rate": float(np.mean([row.success for row in rows])),
        "success_rate_ci95": wilson(sum(row.success for row in rows), len(rows)),
        "success_with_forces": float(np.mean([row.success_with_forces for row in rows])),
        "mean_stones": float(stones.mean()),
        "mean_stones_ci95": mean_interval(stones),
        "std_stones": float(stones.std(ddof=1)) if len(rows) > 1 else None,
        "falls": falls(rows),
        "max_force_ratio": max(row.max_force_ratio for row in rows),
        "min_normal_force": _least(row.min_normal_force for row in rows),
        "worst_margin": _least(row.worst_margin for row in rows),
        "ticks": ticks,
        **summed,
        "qp_solver": qp_solver,
        "qp_solver_share": 1 - summed["qp_unanswered_ticks"] / max(ticks, 1),
        "active_share": {name: sum(getattr(row, f"active_{name}") for row in rows) / max(ticks, 1) for name in ROWS},
        "barrier_active_step_share": sum(row.barrier_active_steps for row in rows) / max(sum(r.steps for r in rows), 1),
        "rms_y": _rms((row.rms_y, row.ticks) for row in rows),
        "rms_dy": _rms((row.rms_dy, row.ticks) for row in rows),
        "max_torque": max(row.max_torque for row in rows),
        "max_slack": max(row.max_slack for row in rows),
        "max_rescue_slack": max(row.max_rescue_slack for row in rows),
        **times(results),
    }


def times(results: Sequence[RunResult]) -> dict[str, float | None]:
    """Of the control tick over all ticks, ms, and simulated over wall seconds of the walks, one process each."""
    every: NDArray[np.float32] = np.concatenate([result.tick_seconds for result in results])
    wall = sum(result.row.walk_seconds for result in results)
    low, high = np.percentile(every * 1e3, [50, 99]).tolist() if every.size else (None, None)
    return {
        "tick_ms_p50": low,
        "tick_ms_p99": high,
        "real_time_factor": sum(result.row.ticks for result in results) * TICK_SECONDS / wall if wall else None,
    }


def falls(rows: Sequence[RunRow]) -> dict[str, int]:
    """How many runs ended otherwise than walked, by kind."""
    return dict(Counter(row.outcome for row in rows if row.outcome != ENDED_WELL))


def wilson(successes: int, runs: int) -> tuple[float, float]:
    """Wilson's 95% interval of a rate."""
    interval = stats.binomtest(successes, runs).proportion_ci(0.95, method="wilson")
    return float(interval.low), float(interval.high)


def mean_interval(values: NDArray[np.float64]) -> tuple[float, float] | None:
    """Student's 95% interval of a mean; None of a single value."""
    if len(values) < 2:
        return None
    half = float(stats.t.ppf(0.975, len(values) - 1) * values.std(ddof=1)) / math.sqrt(len(values))
    return float(values.mean()) - half, float(values.mean()) + half


def _rms(parts: Iterable[tuple[float, int]]) -> float:
    """Root mean square over all ticks, from each run's own and its number of ticks."""
    values, ticks = np.array(list(parts)).T
    return float(np.sqrt((values**2 * ticks).sum() / max(ticks.sum(), 1)))


def _least(values: Any) -> float | None:
    finite = [value for value in values if math.isfinite(value)]
    return min(finite) if finite else None
