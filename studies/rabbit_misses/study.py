"""Walks over the storm's plants that fit the model and, over others, judge it."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from pydantic import BaseModel, ConfigDict
from rabbit_benchmark.cells import storm_plant
from rabbit_benchmark.protocol import STONES
from rabbit_description.state import Array
from rabbit_experiments.assembly import Assembly, resolve_policy
from rabbit_experiments.cache import Cache
from rabbit_experiments.conditions import EVALUATION_LAG
from rabbit_experiments.evaluation import SeededRun, episode, episode_seeds, parts
from rabbit_experiments.summary import wilson
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import load_parameters

from rabbit_misses.model import MissModelError
from rabbit_misses.touchdowns import Touchdowns

FIT_SEED, JUDGE_SEED = 61003, 61011  # of plants and courses; the benchmark has others
BIN_ENDS = (0.01, 0.02, 0.05, 0.15)  # of p
DEMANDED = 0.01


class Steps(BaseModel):
    """Features of a walk's touchdowns, and whether the last step missed; the others did not."""

    model_config = ConfigDict(frozen=True)

    rows: list[list[float]]
    missed: bool


@dataclass(frozen=True)
class SteppedWalk(SeededRun):
    """A walk, seen at its touchdowns."""

    model = Steps

    def do(self) -> Steps:
        seen = Touchdowns()
        with parts(self.assembly) as (simulation, controller):
            episode(simulation, controller, self.seed, seen)
            return Steps(rows=[row.tolist() for row in seen.rows], missed=simulation.outcome.value != "walked")


def stormy_walks(plants: int, seed: int, parameters: str) -> list[SteppedWalk]:
    """One walk on each of so many plants of the storm, those of `seed`, on stones."""
    tuning = load_parameters(parameters)
    walks = []
    for number, course in episode_seeds(seed, plants).items():
        values: dict[str, Any] = {"motor_lag": EVALUATION_LAG, "terrain": "stones", "stones": STONES}
        plant = SimulationParameters.model_validate({**values, **storm_plant(number, seed, "stones")})
        walks.append(
            SteppedWalk(Assembly(plant, tuning, resolve_policy(None, tuning)), course, title=f"plant {number}")
        )
    return walks


def gathered(walks: Sequence[SteppedWalk], cache: Cache) -> tuple[Array, Array]:
    """Features (n, 17) and misses (n,) of all steps; raises `MissModelError` where there is none."""
    rows, missed = list[list[float]](), list[float]()
    for walk in walks:
        steps: Steps = cache.get(walk)
        rows += steps.rows
        missed += [0.0] * len(steps.rows)
        if steps.missed and steps.rows:
            missed[-1] = 1.0
    if not rows:
        raise MissModelError(f"no step in {len(walks)} walks: expected one at least")
    return np.array(rows), np.array(missed)


@dataclass(frozen=True)
class Bin:
    """Steps whose p lies between two ends: mean p, misses, steps, and Wilson's 95% interval of the rate."""

    low: float
    high: float
    p: float
    misses: int
    steps: int

    @property
    def interval(self) -> tuple[float, float]:
        """The interval of the rate."""
        return wilson(self.misses, self.steps)

    @property
    def holds(self) -> bool:
        """Whether the mean p lies in it."""
        low, high = self.interval
        return low <= self.p <= high


@dataclass(frozen=True)
class Judgement:
    """How good probabilities are: bins, Brier's score, and that of the mean rate for every step."""

    bins: list[Bin]
    brier: float
    brier_of_rate: float

    @property
    def skill(self) -> float:
        """1 would be exact, 0 as good as the mean rate; nan where all steps ended alike."""
        return 1 - self.brier / self.brier_of_rate if self.brier_of_rate else math.nan


def judged(p: Array, missed: Array) -> Judgement:
    """Probabilities (n,) against what happened (n,)."""
    bins, ends = [], (0.0, *BIN_ENDS, 1.0)
    for low, high in pairwise(ends):
        inside = (low <= p) & ((p < high) | (high == ends[-1]))
        if inside.any():
            bins.append(Bin(low, high, float(p[inside].mean()), int(missed[inside].sum()), int(inside.sum())))
    rate = missed.mean()
    return Judgement(bins, float(np.mean((p - missed) ** 2)), float(rate * (1 - rate)))
