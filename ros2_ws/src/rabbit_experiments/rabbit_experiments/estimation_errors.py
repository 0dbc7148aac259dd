"""How far a state estimator is from the truth, and whether it knows: walks with a lab's sensors.

At each tick e is the error of (pitch, joint angles, hip velocity, pitch rate, joint rates), n = 12 numbers, P the
covariance that the filter claims, nu its innovation of m numbers with the covariance S.

    NEES = e' P^-1 e / n        NIS = nu' S^-1 nu / m

A consistent filter has a mean of 1 in both. The mean NEES over N independent walks, at one tick, then lies in the
95% interval of chi-square(nN) / (nN). Above 1 the filter is too sure, below 1 it could be surer.
Bar-Shalom, Li, Kirubarajan, "Estimation with applications to tracking and navigation" (2001), section 5.4.
"""

from collections.abc import Iterable
from contextlib import closing
from dataclasses import dataclass
from typing import Any

import numpy as np
from rabbit_description.gait import load_gaits
from rabbit_description.state import Array, RobotState
from rabbit_estimator.contact_aided_filter import ContactAidedFilter
from rabbit_sim.simulation import Simulation
from rl_cbf_clf_controller.controller import Controller
from scipy.stats import chi2

from rabbit_experiments.assembly import Assembly, make_estimator
from rabbit_experiments.evaluation import episode

NAMES = ("pitch", *["joint angles"] * 4, *["hip velocity"] * 2, "pitch rate", *["joint rates"] * 4)
UNITS = {"pitch": "rad", "joint angles": "rad", "hip velocity": "m/s", "pitch rate": "rad/s", "joint rates": "rad/s"}


@dataclass(frozen=True)
class EstimatedWalk:
    """A walk of T ticks: errors and claimed standard deviations (T, 12); NEES and NIS (T,); how it ended."""

    errors: Array
    stds: Array
    nees: Array
    nis: Array
    outcome: str


def estimated_walk(assembly: Assembly, seed: int) -> EstimatedWalk:
    """One walk of the assembly, whose simulation has a lab's sensors."""
    gait, watched = load_gaits(assembly.controller.gait), Watched(make_estimator(assembly.simulation))
    simulation = watched.simulation = Simulation(assembly.simulation, gait, watched.update)
    with closing(simulation):
        episode(simulation, Controller(assembly.controller, gait, assembly.make_policy()), seed)
        errors, stds, nees, nis = (np.array(each) for each in zip(*watched.ticks, strict=True))
        return EstimatedWalk(errors, stds, nees, nis, simulation.outcome.value)


class Watched:
    """A filter that notes its errors; `simulation` tells the truth."""

    simulation: Simulation

    def __init__(self, estimator: ContactAidedFilter) -> None:
        self._filter = estimator
        self.ticks: list[tuple[Array, Array, float, float]] = []

    def update(self, state: RobotState) -> RobotState:
        """The filter's answer."""
        estimated, true = self._filter.update(state), self.simulation.reading
        covariance, innovation = self._filter.angles_and_rates_covariance(), self._filter.innovation
        error = np.concatenate([estimated.q[2:] - true.q[2:], estimated.dq - true.dq])
        nees = float(error @ np.linalg.solve(covariance, error)) / len(error)
        nis = innovation.nis / len(innovation.value) if innovation else np.nan
        self.ticks.append((error, np.sqrt(np.diag(covariance)), nees, nis))
        return estimated


def summarise(walks: Iterable[EstimatedWalk]) -> dict[str, Any]:
    """Errors and consistency over all walks.

    Returns:
        `walks`, `ticks`; `rms` and `claimed` of each group of numbers; `nees`, `nis`: means; `bounds`: of the mean NEES
        over the walks at one tick; `within`, `above`: the share of ticks in which it is in them, and above them.
    """
    walks = list(walks)
    errors, stds = (np.vstack([getattr(walk, name) for walk in walks]) for name in ("errors", "stds"))
    groups = {name: [i for i, each in enumerate(NAMES) if each == name] for name in UNITS}
    shortest = min(len(walk.nees) for walk in walks)
    means = np.mean([walk.nees[:shortest] for walk in walks], axis=0)
    freedom = len(NAMES) * len(walks)
    low, high = (float(chi2.ppf(share, freedom) / freedom) for share in (0.025, 0.975))
    return {
        "walks": len(walks),
        "ticks": len(errors),
        "outcomes": {each: sum(walk.outcome == each for walk in walks) for each in {walk.outcome for walk in walks}},
        "rms": {name: rms(errors[:, columns]) for name, columns in groups.items()},
        "claimed": {name: rms(stds[:, columns]) for name, columns in groups.items()},
        "nees": float(np.mean(np.concatenate([walk.nees for walk in walks]))),
        "nis": float(np.nanmean(np.concatenate([walk.nis for walk in walks]))),
        "bounds": (low, high),
        "within": float(np.mean((means >= low) & (means <= high))),
        "above": float(np.mean(means > high)),
    }


def rms(values: Array) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.square(values).mean()))
