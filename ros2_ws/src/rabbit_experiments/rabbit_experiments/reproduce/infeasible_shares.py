"""Shares of ticks whose rows are infeasible, over the walks of several walkers."""

from collections.abc import Sequence
from typing import Literal

import numpy as np

from rabbit_experiments.reproduce.feasibility import Feasibility
from rabbit_experiments.summary import mean_interval

RowSet = Literal["safety", "all"]


def total(walks: Sequence[Sequence[Feasibility]]) -> int:
    """Ticks."""
    return sum(run.ticks for runs in walks for run in runs)


def share(walks: Sequence[Sequence[Feasibility]], who: int, rows: RowSet) -> float:
    """Of the ticks of these walks in which judge `who` finds its rows infeasible."""
    return sum(getattr(run, rows)[who] for runs in walks for run in runs) / max(total(walks), 1)


def share_text(walks: Sequence[Sequence[Feasibility]], who: int, rows: RowSet) -> str:
    """With Student's 95% interval over the runs' own shares, where there are several."""
    by_run = np.array([getattr(run, rows)[who] / max(run.ticks, 1) for runs in walks for run in runs])
    interval = mean_interval(by_run)
    text = f"{share(walks, who, rows):.2%}"
    return text if interval is None else f"{text} ({max(0.0, interval[0]):.2%} to {min(1.0, interval[1]):.2%})"
