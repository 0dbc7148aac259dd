"""Is a tick's QP feasible with no slack at all? A linear programme over mu decides, apart from any QP solver.

    find mu   such that   lower <= A mu <= upper     for the rows of the tick

Two sets of rows, both with saturation: `safety`, barriers and ground forces (the paper's QP, where d relaxes the CLF
row and nothing else is relaxed), and `all`, with the CLF row as well.

The rows are each judge's own, margins and estimates included. All judges see the states of one walk, stepped tick by
tick, so a judge that adapts has seen what the walker saw; its torque goes nowhere.
"""

from collections.abc import Sequence
from contextlib import closing
from dataclasses import dataclass
from typing import Literal

import numpy as np
from cbf_clf_qp.functions import Array
from cbf_clf_qp.qp import UNBOUNDED
from pydantic import BaseModel, ConfigDict
from rabbit_description.state import RobotState
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.evaluation import SeededRun, ended, episode
from rabbit_experiments.summary import mean_interval
from rl_cbf_clf_controller.controller import Controller
from rl_trainer.rollout import Record
from scipy.optimize import linprog

INFEASIBLE = 2  # linprog's status
RowSet = Literal["safety", "all"]


class Feasibility(BaseModel):
    """One walk: `ticks`, and for each judge how many of them are infeasible, by set of rows."""

    model_config = ConfigDict(frozen=True)

    outcome: str
    ticks: int
    safety: tuple[int, ...]
    all: tuple[int, ...]


@dataclass(frozen=True)
class JudgedWalk(SeededRun):
    """A walk whose ticks the `judges` judge."""

    judges: tuple[Assembly, ...]
    model = Feasibility

    @property
    def assemblies(self) -> tuple[Assembly, ...]:
        return (self.assembly, *self.judges)

    def do(self) -> Feasibility:
        return measure(self.assembly, self.judges, self.seed)


def infeasible(A: Array, lower: Array, upper: Array) -> bool:
    """Whether a linear programme proves that no mu (m,) has `lower` <= A mu <= `upper`, A being (k, m)."""
    norm = np.maximum(np.linalg.norm(A, axis=1), 1e-12)
    sides = np.concatenate([A, -A]) / np.tile(norm, 2)[:, None]
    bounds = np.concatenate([upper, -lower]) / np.tile(norm, 2)
    finite = bounds < UNBOUNDED / 2
    done = linprog(np.zeros(A.shape[1]), A_ub=sides[finite], b_ub=bounds[finite], bounds=(None, None), method="highs")
    return bool(done.status == INFEASIBLE)


def measure(walker: Assembly, judges: Sequence[Assembly], seed: int) -> Feasibility:
    """Walk once, and judge every tick.

    Raises:
        ValueError: a judge of the first approach, whose rows are not in mu alone.
    """
    simulation, controller = walker.build()
    asked = [_judge(assembly) for assembly in judges]
    counts = np.zeros((2, len(asked)), dtype=int)
    ticks: list[Record] = []

    def look(record: Record) -> None:
        ticks.append(record)
        for i, judge in enumerate(asked):
            counts[:, i] += _verdicts(judge, record.state)

    with closing(simulation):
        fault = episode(simulation, controller, seed, look)
    safety, every = counts.tolist()
    outcome = ended(simulation, fault, ticks)
    return Feasibility(outcome=outcome, ticks=len(ticks), safety=tuple(safety), all=tuple(every))


def _judge(assembly: Assembly) -> Controller:
    if assembly.controller.problem.corrects_input:
        raise ValueError(f"{assembly.controller.controller}: expected a controller whose rows hold its estimates")
    simulation, judge = assembly.build()
    simulation.close()
    return judge


def _verdicts(judge: Controller, state: RobotState) -> tuple[bool, bool]:
    """Whether the safety rows, and all rows, are infeasible for a judge at a state."""
    judge.step(state)
    estimates, scene = judge.estimates, judge.scene
    data = judge.qp.programme(scene.x, scene.p, estimates)
    layout = judge.qp.layout
    rows = data.A[:, : layout.inputs], data.lower, data.upper  # over root mu, which is as free as mu
    every = infeasible(*rows)
    safety = np.array(layout.names) != "CLF"
    return every and infeasible(*(part[safety] for part in rows)), every


def total(walks: Sequence[Sequence[Feasibility]]) -> int:
    """Ticks of the walks of several walkers."""
    return sum(run.ticks for runs in walks for run in runs)


def share(walks: Sequence[Sequence[Feasibility]], who: int, rows: RowSet) -> float:
    """The share of these walks' ticks in which judge `who` finds its rows infeasible."""
    return sum(getattr(run, rows)[who] for runs in walks for run in runs) / max(total(walks), 1)


def share_text(walks: Sequence[Sequence[Feasibility]], who: int, rows: RowSet) -> str:
    """The share with Student's 95% interval over the runs' own shares, where there are several."""
    by_run = np.array([getattr(run, rows)[who] / max(run.ticks, 1) for runs in walks for run in runs])
    interval = mean_interval(by_run, 0.0, 1.0)
    text = f"{share(walks, who, rows):.2%}"
    return text if interval is None else f"{text} ({interval[0]:.2%} to {interval[1]:.2%})"
