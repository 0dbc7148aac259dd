"""How far a state estimator is from the truth, and whether it knows: walks with a lab's sensors.

At each tick e is the error of (pitch, joint angles, hip velocity, pitch rate, joint rates), n = 12 numbers, P the
covariance that the filter claims, nu its innovation of m numbers with the covariance S.

    NEES = e' P^-1 e / n        NIS = nu' S^-1 nu / m

A consistent filter has a mean of 1 in both. The mean NEES over N independent walks, at one tick, then lies in the
95% interval of chi-square(nN) / (nN), and the mean of nu' S^-1 nu likewise with the sum of the walks' m. Above 1 the
filter is too sure, below 1 it could be surer.
Bar-Shalom, Li, Kirubarajan, "Estimation with applications to tracking and navigation" (2001), section 5.4.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import numpy as np
from rabbit_description.gait import load_gaits
from rabbit_description.state import Array, RobotState
from rabbit_estimator.contact_aided_filter import ContactAidedFilter
from rabbit_experiments.assembly import Assembly, make_estimator
from rabbit_experiments.evaluation import episode
from rabbit_sim.simulation import Simulation
from rl_cbf_clf_controller.controller import Controller
from scipy.stats import chi2

NAMES = ("pitch", *["joint angles"] * 4, *["hip velocity"] * 2, "pitch rate", *["joint rates"] * 4)
AFTER = 10  # ticks from a touchdown, in which impacts and their echoes are
UNITS = {"pitch": "rad", "joint angles": "rad", "hip velocity": "m/s", "pitch rate": "rad/s", "joint rates": "rad/s"}
GROUPS = {name: [i for i, other in enumerate(NAMES) if other == name] for name in UNITS}


@dataclass(frozen=True)
class EstimatedWalk:
    """A walk of T ticks: errors and claimed standard deviations (T, 12); how it ended.

    `nees` (T,), and `parts` (T, 5), that of each group of `UNITS` alone; `nis` (T,) and its m, `measured` (T,), which
    is 0 at tick 0; `since` (T,): ticks since the last touchdown, or the start.
    """

    outcome: str
    errors: Array
    stds: Array
    nees: Array
    parts: Array
    nis: Array
    measured: Array
    since: Array


def estimated_walk(assembly: Assembly, seed: int) -> EstimatedWalk:
    """One walk of the assembly, whose simulation has a lab's sensors."""
    gait, watched = load_gaits(assembly.controller.gait), Watched(make_estimator(assembly.simulation))
    simulation = watched.simulation = Simulation(assembly.simulation, gait, watched.update)
    with closing(simulation):
        episode(simulation, Controller(assembly.controller, gait, assembly.make_policy()), seed)
        return EstimatedWalk(simulation.outcome.value, *map(np.array, zip(*watched.ticks, strict=True)))


class Watched:
    """A filter that notes its errors; `simulation` tells the truth."""

    simulation: Simulation

    def __init__(self, estimator: ContactAidedFilter) -> None:
        self._filter = estimator
        self.ticks: list[tuple[Array, Array, float, list[float], float, int, int]] = []
        self._landed = (0, 0)  # touchdowns, and the tick of the last one

    def update(self, state: RobotState) -> RobotState:
        """The filter's answer."""
        estimated, true = self._filter.update(state), self.simulation.reading
        covariance, belief = self._filter.angles_and_rates_covariance(), self._filter.belief
        error = np.concatenate([estimated.q[2:] - true.q[2:], estimated.dq - true.dq])
        parts = [normalised(error[group], covariance[np.ix_(group, group)]) for group in GROUPS.values()]
        measured = int(belief.measured[0])
        nis = belief.nis.item() / max(measured, 1)
        if state.touchdowns != self._landed[0]:
            self._landed = (state.touchdowns, state.tick)
        since = state.tick - self._landed[1]
        std = np.sqrt(np.diag(covariance))
        self.ticks.append((error, std, normalised(error, covariance), parts, nis, measured, since))
        return estimated


def summarise(walks: Iterable[EstimatedWalk]) -> dict[str, Any]:
    """Errors and consistency over all walks.

    Returns:
        `walks`, `ticks`, `outcomes`; `rms`, `claimed` and `nees_of` each group of numbers; `nees`, `nis`: means;
        `nees_after_touchdown`: in the ticks after one; `bounds`: of the mean NEES over all walks at one tick; `within`,
        `above`: the share of ticks in which it is in them, and above them; `nis_within`, `nis_above`: of the NIS. A
        tick counts that at least half of the walks have, with the bounds of these.
    """
    walks = list(walks)
    errors, stds, parts = (np.vstack([getattr(walk, name) for walk in walks]) for name in ("errors", "stds", "parts"))
    nees, since = (np.concatenate([getattr(walk, name) for walk in walks]) for name in ("nees", "since"))
    within, above = shares([np.column_stack([walk.nees, np.full(len(walk.nees), len(NAMES))]) for walk in walks])
    nis_within, nis_above = shares([np.column_stack([walk.nis, walk.measured])[1:] for walk in walks])
    low, high = bounds(len(NAMES) * len(walks))
    return {
        "walks": len(walks),
        "ticks": len(errors),
        "outcomes": Counter(walk.outcome for walk in walks),
        "rms": {name: rms(errors[:, group]) for name, group in GROUPS.items()},
        "claimed": {name: rms(stds[:, group]) for name, group in GROUPS.items()},
        "nees_of": dict(zip(GROUPS, parts.mean(axis=0).tolist(), strict=True)),
        "nees": float(nees.mean()),
        "nees_after_touchdown": float(nees[since < AFTER].mean()),
        "nis": float(np.mean(np.concatenate([walk.nis[1:] for walk in walks]))),
        "bounds": (float(low), float(high)),
        "within": within,
        "above": above,
        "nis_within": nis_within,
        "nis_above": nis_above,
    }


def shares(walks: Sequence[Array]) -> tuple[float, float]:
    """The shares of ticks in which the mean over the walks is within its bounds, and above them.

    A walk of T ticks is normalised squares and their freedom, (T, 2).
    """
    ticks = sorted((len(walk) for walk in walks), reverse=True)[(len(walks) - 1) // 2]
    freedom, total = np.zeros(ticks), np.zeros(ticks)
    for walk in walks:
        some = walk[:ticks]
        freedom[: len(some)] += some[:, 1]
        total[: len(some)] += some[:, 0] * some[:, 1]
    low, high = bounds(freedom)
    mean = total / freedom
    return float(np.mean((mean >= low) & (mean <= high))), float(np.mean(mean > high))


def normalised(error: Array, covariance: Array) -> float:
    """e' P^-1 e over the number of numbers."""
    return float(error @ np.linalg.solve(covariance, error)) / len(error)


def bounds(freedom: Any) -> tuple[Any, Any]:
    """95% interval of the mean of so many squared standard normal numbers, a number or an array of them."""
    return tuple(chi2.ppf(share, freedom) / freedom for share in (0.025, 0.975))


def rms(values: Array) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.square(values).mean()))
