"""One run in figures, taken tick by tick.

Forces are the true ones at the tick's beginning, the mean over the tick before, on the foot that stands. A landing
happens in the tick before the one that swaps the legs, so in ticks of 10 ms the whole mean is more than 30 ms after
the impact from the fifth tick of a step on; earlier ticks are "at impact". A force violation is a later tick over the
cone (with F_N > 20 N) or without a push from the ground (F_N <= 0, "lost").
"""

import json
import math
from collections.abc import Iterable, Sequence
from typing import Annotated, ClassVar, Literal

import numpy as np
from cbf_clf_qp.functions import Layout
from cbf_clf_qp.qp import ROUNDING as AT_BOUND
from pydantic import BaseModel, BeforeValidator, ConfigDict, PlainSerializer
from rabbit_description.force_ratio import force_ratio, impact_ticks
from rabbit_description.state import JOINTS, Array
from rabbit_sim.simulation import Landing, Outcome
from rl_cbf_clf_controller.batch_output import BatchOutput
from rl_cbf_clf_controller.controller_output import ControllerOutput
from rl_cbf_clf_controller.controller_parts import ControllerParts
from rl_cbf_clf_controller.message_fields import STONE_BARRIERS
from rl_cbf_clf_controller.parameters import ControllerParameters

from rabbit_experiments.walk_records import RESCUE_NEEDED

SLACK_USED = 1e-3  # least d that counts, in its row's unit: whether d is less or 0 depends on the processor's rounding
ROWS = ("CLF", "B1", "B2", "C1", "C2", "u")  # of the QP, both cone rows as C2 and all saturation rows as u


def least(values: Iterable[float]) -> float | None:
    """The least that is finite."""
    return min(filter(math.isfinite, values), default=None)


Count = Annotated[int, sum]  # with what a summary makes of all runs' figures
Most = Annotated[float, max]
Least = Annotated[float, least]


def least_by_name(values: Iterable[dict[str, float]]) -> dict[str, float]:
    """The least of each name."""
    least: dict[str, float] = {}
    for of_run in values:
        least |= {name: min(value, least.get(name, math.inf)) for name, value in of_run.items()}
    return least


ByName = Annotated[  # in a cell of a table as JSON
    dict[str, float],
    least_by_name,
    BeforeValidator(lambda cell: json.loads(cell) if isinstance(cell, str) else cell),
    PlainSerializer(json.dumps),
]


class RunRow(BaseModel):
    """A row of runs.csv. Counts are ticks unless named otherwise; forces in N; times in s or ms."""

    model_config = ConfigDict(frozen=True)

    run: int
    seed: int
    outcome: str
    success: bool
    success_with_forces: bool
    stones: int
    missed_stones: Count
    steps: int
    ticks: Count
    worst_margin: Least
    least_barriers: ByName = {}  # B, by name
    max_force_ratio: Most
    min_normal_force: Least
    ticks_over_cone: Count
    ticks_over_cone_at_impact: Count
    ticks_normal_force_negative: Count
    ticks_lost: Count
    ticks_lost_at_impact: Count
    qp_unanswered_ticks: Count
    qp_unconstrained_ticks: Count
    slack_ticks: Count
    rescue_ticks: Count
    saturated_ticks: Count
    ecbf_start_violations: Count
    active_CLF: int
    active_B1: int
    active_B2: int
    active_C1: int
    active_C2: int
    active_u: int
    barrier_active_steps: int
    max_torque: Most
    rms_y: float
    rms_dy: float
    max_clf: float
    max_slack: Most
    max_rescue_slack: Most
    tick_ms_p50: float
    tick_ms_p99: float
    plant_ms_p50: float
    walk_seconds: float


class ForceTick(BaseModel):
    """A tick whose stance foot was over the friction cone (with F_N > 20 N), or was not pushed at all (lost)."""

    model_config = ConfigDict(frozen=True)

    run: int
    kind: Literal["over_cone", "lost"]
    tick: int
    step: int
    ticks_since_landing: int
    at_impact: bool
    tangential_force: float
    normal_force: float
    ratio: float


class RunResult(BaseModel):
    """What a run leaves behind: its row, its force violations, and the seconds each control tick took, to 0.1 us."""

    model_config = ConfigDict(frozen=True)

    row: RunRow
    violations: list[ForceTick]
    tick_seconds: list[float]


def qp_row(name: str) -> str:
    """The name in `ROWS` of a row of the QP, if it has one."""
    return name if name in ROWS else name[: 1 if name[0] == "u" else 2]


class TickColumns:
    """The numbers of a tick that a tally keeps, in a row; `barriers`: their names."""

    SIZES: ClassVar = {"tick": 1, "step": 1, "force": 2, "V": 1, "slack": 1, "rescue": 1, "answered": 1, "saturated": 1}
    SIZES |= {"active": len(ROWS), "is_constrained": 1, "torque": JOINTS, "eta": 2 * JOINTS}

    def __init__(self, barriers: Sequence[str]) -> None:
        self.barriers = tuple(barriers)
        self.layout = Layout(self.SIZES | {"B": len(barriers), "B_rate": len(barriers)})

    def of(self, output: ControllerOutput, force: Array) -> Array:
        """The row of one robot's tick; `force` (2, 2): the true ones, N."""
        row = np.empty(self.layout.size)
        active = {qp_row(name) for name in output.active}
        row[:] = [
            *(output.tick, output.step_index, *force[output.stance].tolist()),
            *(output.V, output.clf_slack, output.rescue_slack, output.answered, output.saturated),
            *(name in active for name in ROWS),
            *(bool(output.active), *output.torque.tolist(), *output.eta.tolist()),
            *(*output.barriers.tolist(), *output.barrier_rates.tolist()),
        ]
        return row


class BatchColumns(TickColumns):
    """The same of N robots under one controller, taken from their reports at once."""

    def __init__(self, one: ControllerParts) -> None:
        super().__init__(one.barrier_names)
        at = one.output_places
        tick, step, self._stance, _, _, V, self._solved, slack, rescue = at.scalars
        copied = {"tick": tick, "step": step, "V": V, "slack": slack, "rescue": rescue, "saturated": one.acted_at[2]}
        copied |= {"torque": one.places["command"], "eta": at.arrays["eta"]}
        copied |= {"B": at.arrays["barriers"], "B_rate": at.arrays["barrier_rates"]}
        self._of_report = np.r_[tuple(copied.values())]
        self._into = np.r_[tuple(self.layout.places[name][0] for name in copied)]
        self._margin, self._solver = at.margin, one.parameters.qp_solver
        self._is_in = np.array([[qp_row(name) == row for row in ROWS] for name in one.qp.layout.names])

    def of_all(self, output: BatchOutput, force: Array) -> Array:
        """A row a robot; `force` (N, 2, 2): the true ones, N."""
        report, places = output.report, self.layout.places
        rows = np.empty((len(report), self.layout.size))
        rows[:, self._into] = report[:, self._of_report]
        stance, active = report[:, self._stance].astype(int), report[:, self._margin] < AT_BOUND
        rows[:, places["force"][0]] = force[np.arange(len(rows)), stance]
        by_solver = np.array([solver == self._solver for solver in output.solvers])
        rows[:, places["answered"][0].start] = (report[:, self._solved] > 0) & by_solver
        rows[:, places["active"][0]] = active @ self._is_in
        rows[:, places["is_constrained"][0].start] = active.any(axis=1)
        return rows


class RunTally:
    """Collects the ticks of a run, in `rows` as `columns` has them; `result` reduces them."""

    def __init__(self, run: int, parameters: ControllerParameters) -> None:
        self.run = run
        self.fault, self._impact_ticks = "", impact_ticks(parameters.tick_seconds)
        self._friction_coeff, self._pole = parameters.friction_coeff, parameters.barrier_pole_1
        self.rows, self.columns = list[Array](), TickColumns(())

    @property
    def ticks(self) -> int:
        """So far."""
        return len(self.rows)

    def add(self, row: Array, columns: TickColumns) -> None:
        """Take in a tick."""
        self.columns = columns
        self.rows.append(row)

    def observe(self, output: ControllerOutput, force: Array) -> None:
        """The same of what a controller said; `force` (2, 2): the true ones at this tick."""
        self.fault = output.fault
        columns = self.columns if self.rows else TickColumns(output.barrier_names)
        self.add(columns.of(output, force), columns)

    def result(
        self,
        seed: int,
        outcome: Outcome,
        landings: list[Landing],
        ticks: list[float],
        plant_ticks: list[float],
        walk_seconds: float = 0.0,
    ) -> RunResult:
        """The run in figures, once it is over; seconds that each controller and plant tick took, and the whole walk."""
        columns = self.columns
        rows = np.reshape(self.rows, (-1, columns.layout.size))
        of = {name: rows[:, place] for name, (place, _) in columns.layout.places.items()}
        tick, step, V, slack, rescue = (of[name][:, 0] for name in ("tick", "step", "V", "slack", "rescue"))
        force, torque, eta, B = (of[name] for name in ("force", "torque", "eta", "B"))
        normal, active = force[:, 1], of["active"] > 0
        starts = np.diff(step, prepend=-1) != 0
        age = tick - tick[starts][np.cumsum(starts) - 1]
        ratio = np.nan_to_num(force_ratio(force))
        measured, at_impact = tick > 0, age < self._impact_ticks  # at tick 0 there is no force yet
        over, lost, late = measured & (ratio > self._friction_coeff), measured & (normal <= 0), measured & ~at_impact
        on_stones = [name in STONE_BARRIERS for name in columns.barriers]
        outside = np.any((of["B_rate"] + self._pole * B)[:, on_stones] < 0, axis=1)  # where an ECBF promises nothing
        by_barrier = active[:, [name in STONE_BARRIERS for name in ROWS]].any(axis=1)
        happened = {
            "ticks_over_cone": over & ~at_impact,
            "ticks_over_cone_at_impact": over & at_impact,
            "ticks_normal_force_negative": measured & (normal < 0),
            "ticks_lost": lost & ~at_impact,
            "ticks_lost_at_impact": lost & at_impact,
            "qp_unanswered_ticks": of["answered"] == 0,
            "qp_unconstrained_ticks": of["is_constrained"] == 0,
            "slack_ticks": slack > SLACK_USED,
            "rescue_ticks": rescue > RESCUE_NEEDED,
            "saturated_ticks": of["saturated"] == 1,
            "ecbf_start_violations": starts & outside,
        }
        counts = {name: int(np.sum(ticks)) for name, ticks in happened.items()}
        counts |= {f"active_{name}": int(np.sum(ticks)) for name, ticks in zip(ROWS, active.T, strict=True)}
        missed = [landing.missed or not landing.on_stone for landing in landings]
        success = outcome is Outcome.WALKED and not self.fault and not any(missed)
        y, dy = (np.square(eta).sum(axis=0) / max(self.ticks, 1)).reshape(2, -1)
        milliseconds = np.array(ticks) * 1e3
        row = RunRow(
            run=self.run,
            seed=seed,
            outcome=self.fault.split(":")[0] or outcome.value,
            success=success,
            success_with_forces=success and not counts["ticks_over_cone"] and not counts["ticks_lost"],
            stones=missed.index(True) if True in missed else len(missed),
            missed_stones=sum(missed),
            steps=int(step[-1]) + 1 if self.ticks else 0,
            ticks=self.ticks,
            worst_margin=min((min(step.l - step.l_min, step.l_max - step.l) for step in landings), default=np.nan),
            least_barriers=dict(zip(columns.barriers, np.fmin.reduce(B, initial=np.inf).tolist(), strict=True)),
            max_force_ratio=ratio[late].max(initial=0.0),
            min_normal_force=normal[late].min() if late.any() else np.nan,
            barrier_active_steps=len(set(step[by_barrier].tolist())),
            max_torque=np.abs(torque).max(initial=0.0),
            rms_y=float(np.sqrt(y.mean())),
            rms_dy=float(np.sqrt(dy.mean())),
            max_clf=np.fmax.reduce(V, initial=0.0),
            max_slack=np.fmax.reduce(slack, initial=0.0),
            max_rescue_slack=np.fmax.reduce(rescue, initial=0.0),
            tick_ms_p50=float(np.percentile(milliseconds, 50)) if ticks else np.nan,
            tick_ms_p99=float(np.percentile(milliseconds, 99)) if ticks else np.nan,
            plant_ms_p50=float(np.median(plant_ticks)) * 1e3 if plant_ticks else np.nan,
            walk_seconds=walk_seconds,
            **counts,
        )
        when = {"tick": tick, "step": step, "ticks_since_landing": age, "at_impact": at_impact}
        of_tick = {**when, "tangential_force": force[:, 0], "normal_force": normal, "ratio": ratio}
        violations = [
            ForceTick(run=self.run, kind="lost" if lost[i] else "over_cone", **{n: v[i] for n, v in of_tick.items()})
            for i in np.flatnonzero(over | lost)
        ]
        return RunResult(row=row, violations=violations, tick_seconds=[round(seconds, 7) for seconds in ticks])
