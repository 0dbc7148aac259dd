"""From runs to figures: rates with Wilson's interval, means with Student's, counts and times."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rabbit_description.state import TICK_SECONDS
from scipy import stats

from rabbit_experiments.metrics import ROWS, RunResult, RunRow

ENDED_WELL = "walked"
ENOUGH = 0.9  # share of runs from which something "walks"


@dataclass(frozen=True)
class Walks:
    """Rows of runs, one at least, and the figures over them; `course`: stones or steps of a run, inf where unknown."""

    rows: Sequence[RunRow]
    course: float = math.inf

    @property
    def runs(self) -> int:
        """How many."""
        return len(self.rows)

    @property
    def walked(self) -> int:
        """Runs to the end of the course, without a miss or a fall."""
        return self.total("success")

    @property
    def with_forces(self) -> int:
        """Runs among these whose forces kept the cone and the ground's push, more than 30 ms after each impact."""
        return self.total("success_with_forces")

    @property
    def passes(self) -> bool:
        """Nine of ten walked."""
        return self.walked >= ENOUGH * self.runs

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's 95% interval of the rate."""
        return wilson(self.walked, self.runs)

    @property
    def stones(self) -> NDArray[np.float64]:
        """Stones of each run, or steps on flat ground, before the first miss or fall."""
        return np.array([row.stones for row in self.rows], dtype=float)

    @property
    def mean_stones(self) -> float:
        """The runs' mean number of stones."""
        return float(self.stones.mean())

    @property
    def std_stones(self) -> float | None:
        """Sample deviation; None of one run."""
        return float(self.stones.std(ddof=1)) if self.runs > 1 else None

    @property
    def stones_interval(self) -> tuple[float, float] | None:
        """Student's 95% interval of the mean, within the course; None of one run."""
        return mean_interval(self.stones, 0.0, self.course)

    @property
    def max_ratio(self) -> float:
        """Largest |F_T| / F_N more than 30 ms after an impact."""
        return max(row.max_force_ratio for row in self.rows)

    @property
    def falls(self) -> dict[str, int]:
        """How many runs ended otherwise than walked, by kind."""
        return dict(Counter(row.outcome for row in self.rows if row.outcome != ENDED_WELL))

    @property
    def over_all(self) -> dict[str, Any]:
        """Counts and extremes: of each column of `RunRow` that says how, that of all runs."""
        over = {name: info.metadata[0] for name, info in RunRow.model_fields.items() if info.metadata}
        return {name: combine(getattr(row, name) for row in self.rows) for name, combine in over.items()}

    def total(self, name: str) -> int:
        """Sum of a count of `RunRow`."""
        return sum(getattr(row, name) for row in self.rows)

    def rms(self, name: str) -> float:
        """Over all ticks, of a root mean square of `RunRow`."""
        values, ticks = np.array([(getattr(row, name), row.ticks) for row in self.rows]).T
        return float(np.sqrt((values**2 * ticks).sum() / max(ticks.sum(), 1)))

    @property
    def rate_text(self) -> str:
        """Walked of runs, interval."""
        low, high = self.interval
        return f"{self.walked} of {self.runs} ({low:.2f} to {high:.2f})"

    @property
    def text(self) -> str:
        """Walked of runs, interval, mean stones."""
        return f"{self.rate_text}, {self.mean_stones:.1f}"


def summarise(
    results: Sequence[RunResult], qp_solver: str, course: float = math.inf, tick_seconds: float = TICK_SECONDS
) -> dict[str, Any]:
    """The figures of summary.json; `course`: stones or steps of each run."""
    walks = Walks([result.row for result in results], course)
    ticks = max(walks.total("ticks"), 1)
    return {
        "runs": walks.runs,
        "success_rate": walks.walked / walks.runs,
        "success_rate_ci95": walks.interval,
        "success_with_forces": walks.with_forces / walks.runs,
        "mean_stones": walks.mean_stones,
        "mean_stones_ci95": walks.stones_interval,
        "std_stones": walks.std_stones,
        "falls": walks.falls,
        **walks.over_all,
        "qp_solver": qp_solver,
        "qp_solver_share": 1 - walks.total("qp_unanswered_ticks") / ticks if walks.total("ticks") else None,
        "active_share": {name: walks.total(f"active_{name}") / ticks for name in ROWS},
        "barrier_active_step_share": walks.total("barrier_active_steps") / max(walks.total("steps"), 1),
        "rms_y": walks.rms("rms_y"),
        "rms_dy": walks.rms("rms_dy"),
        **times(results, tick_seconds),
    }


def times(results: Sequence[RunResult], tick_seconds: float = TICK_SECONDS) -> dict[str, float | None]:
    """Times of the control tick over all ticks, ms, and simulated over wall seconds of the walks, one process each."""
    every = np.concatenate([result.tick_seconds for result in results])
    wall = sum(result.row.walk_seconds for result in results)
    low, high = np.percentile(every * 1e3, [50, 99]).tolist() if every.size else (None, None)
    return {
        "tick_ms_p50": low,
        "tick_ms_p99": high,
        "real_time_factor": sum(result.row.ticks for result in results) * tick_seconds / wall if wall else None,
    }


def wilson(successes: int, runs: int) -> tuple[float, float]:
    """Wilson's 95% interval of a rate."""
    interval = stats.binomtest(successes, runs).proportion_ci(0.95, method="wilson")
    return float(interval.low), float(interval.high)


def mean_interval(
    values: NDArray[np.float64], low: float = -math.inf, high: float = math.inf
) -> tuple[float, float] | None:
    """Student's 95% interval of a mean, as far as a mean of values between `low` and `high` can lie in it.

    So it holds the mean as often as before. None of a single value.
    """
    if len(values) < 2:
        return None
    mean, half = values.mean(), stats.t.ppf(0.975, len(values) - 1) * values.std(ddof=1) / math.sqrt(len(values))
    return float(max(low, mean - half)), float(min(high, mean + half))
