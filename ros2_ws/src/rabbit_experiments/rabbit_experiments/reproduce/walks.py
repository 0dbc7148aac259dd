"""Runs of one assembly, and the figures over them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from rabbit_experiments.assembly import Assembly
from rabbit_experiments.evaluation import episode_seeds
from rabbit_experiments.metrics import RunRow
from rabbit_experiments.reproduce.jobs import Job
from rabbit_experiments.reproduce.verdict import ENOUGH
from rabbit_experiments.summary import mean_interval, wilson

SEED = 50001  # of every course and first state here, where a line has no other, and of nothing else


@dataclass(frozen=True)
class Case:
    """`runs` runs of an assembly; run i is run i of `rabbit evaluate --seed SEED`."""

    assembly: Assembly
    runs: int
    title: str
    seed: int = SEED

    @property
    def jobs(self) -> list[Job]:
        """One a run."""
        return [
            Job("walk", self.assembly, seed, title=self.title) for seed in episode_seeds(self.seed, self.runs).values()
        ]

    @property
    def records(self) -> Job:
        """The first run, with all its ticks."""
        return Job("records", self.assembly, episode_seeds(self.seed, 1)[0], title=self.title)


@dataclass(frozen=True)
class Walks:
    """Rows of the runs of a case."""

    rows: Sequence[RunRow]

    @property
    def runs(self) -> int:
        """How many."""
        return len(self.rows)

    @property
    def walked(self) -> int:
        """Runs to the end of the course, without a miss or a fall."""
        return sum(row.success for row in self.rows)

    @property
    def with_forces(self) -> int:
        """Of these, runs whose forces kept the cone and the ground's push, more than 30 ms after each impact."""
        return sum(row.success_with_forces for row in self.rows)

    @property
    def passes(self) -> bool:
        """Nine of ten walked."""
        return self.walked >= ENOUGH * self.runs

    @property
    def interval(self) -> tuple[float, float]:
        """Wilson's 95% interval of the rate."""
        return wilson(self.walked, self.runs)

    @property
    def mean_stones(self) -> float:
        """Stones, or steps on flat ground, before the first miss or fall."""
        return float(np.mean([row.stones for row in self.rows]))

    @property
    def std_stones(self) -> float | None:
        """Sample deviation; None of one run."""
        return float(np.std([row.stones for row in self.rows], ddof=1)) if self.runs > 1 else None

    @property
    def stones_interval(self) -> tuple[float, float] | None:
        """Student's 95% interval of the mean; None of one run."""
        return mean_interval(np.array([row.stones for row in self.rows], dtype=float))

    @property
    def max_ratio(self) -> float:
        """Largest |F_T| / F_N more than 30 ms after an impact."""
        return max(row.max_force_ratio for row in self.rows)

    def rms(self, name: str) -> float:
        """Over all ticks, of a root mean square of `RunRow`."""
        parts = np.array([(getattr(row, name), row.ticks) for row in self.rows])
        return float(np.sqrt((parts[:, 0] ** 2 * parts[:, 1]).sum() / max(parts[:, 1].sum(), 1)))

    def total(self, name: str) -> int:
        """Sum of a count of `RunRow`."""
        return sum(getattr(row, name) for row in self.rows)

    @property
    def text(self) -> str:
        """Walked of runs, interval, mean stones."""
        low, high = self.interval
        return f"{self.walked} of {self.runs} ({low:.2f} to {high:.2f}), {self.mean_stones:.1f}"
