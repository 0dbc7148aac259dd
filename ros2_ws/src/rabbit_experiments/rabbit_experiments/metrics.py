"""One run in figures, taken tick by tick.

Forces are the true ones at the tick's beginning, the mean over the tick before, on the foot that stands. A landing
happens in the tick before the one that swaps the legs, so in ticks of 10 ms the whole mean is more than 30 ms after
the impact from the fourth tick of a step on; earlier ticks are "at impact". A force violation is a later tick over the
cone (with F_N > 20 N) or without a push from the ground (F_N <= 0, "lost").
"""

import json
import math
from collections import Counter
from collections.abc import Callable, Iterable
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, BeforeValidator, ConfigDict, PlainSerializer
from rabbit_description.force_ratio import force_ratio, impact_ticks
from rabbit_description.state import JOINTS, Array
from rabbit_sim.simulation import Landing, Outcome
from rl_cbf_clf_controller.message_fields import STONE_BARRIERS
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_trainer.rollout import Record

from rabbit_experiments.walk_records import RESCUE_NEEDED

SLACK_USED = 1e-3  # least d that counts, in its row's unit: whether d is less or 0 depends on the processor's rounding
NUMBERS = 9  # of a tick, before its torque and eta
ROWS = ("CLF", "B1", "B2", "C1", "C2", "u")  # of the QP, both cone rows as C2 and all saturation rows as u


def least(values: Iterable[float]) -> float | None:
    """The least that is finite."""
    return min(filter(math.isfinite, values), default=None)


Count = Annotated[int, sum]  # with what a summary makes of all runs' figures
Most = Annotated[float, max]
Least = Annotated[float, least]


def least_by_name(values: Iterable[dict[str, float]]) -> dict[str, float]:
    """The least of each name."""
    found: dict[str, float] = {}
    for each in values:
        found |= {name: min(value, found.get(name, math.inf)) for name, value in each.items()}
    return found


ByName = Annotated[  # in a cell of a table as JSON
    dict[str, float],
    least_by_name,
    BeforeValidator(lambda given: json.loads(given) if isinstance(given, str) else given),
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


class RunTally:
    """Observes a rollout; `result` reduces it. `foot_force` gives the true forces, (2, 2), at the present tick."""

    def __init__(self, run: int, parameters: ControllerParameters, foot_force: Callable[[], Array]) -> None:
        self.run, self._foot_force = run, foot_force
        self.fault, self._impact_ticks = "", impact_ticks(parameters.tick_seconds)
        self._friction_coeff, self._pole = parameters.friction_coeff, parameters.barrier_pole_1
        self._rows: list[list[float]] = []
        self._active: list[tuple[str, ...]] = []
        self._barriers: list[tuple[tuple[str, ...], list[float], list[float]]] = []  # names, B, B-dot

    @property
    def ticks(self) -> int:
        """So far."""
        return len(self._rows)

    def __call__(self, record: Record) -> None:
        """Take in a tick."""
        output = record.output
        self.fault = output.fault
        force = self._foot_force()[output.stance].tolist()
        numbers = output.V, output.clf_slack, output.rescue_slack, output.answered, output.saturated
        arrays = output.torque.tolist() + output.eta.tolist()
        self._rows.append([output.tick, output.step_index, *force, *numbers, *arrays])
        self._active.append(output.active)
        self._barriers.append((output.barrier_names, output.barriers.tolist(), output.barrier_rates.tolist()))

    def _is_outside(self, tick: int) -> bool:
        """Of the set from which an ECBF keeps a stone's barriers: outside it promises nothing."""
        of_all = zip(*self._barriers[tick], strict=True)
        return any(rate + self._pole * B < 0 for name, B, rate in of_all if name in STONE_BARRIERS)

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
        rows = np.reshape(self._rows, (-1, NUMBERS + 3 * JOINTS))
        tick, step, tangential, normal, V, slack, rescue, answered, saturated = rows[:, :NUMBERS].T
        torque, eta = np.split(rows[:, NUMBERS:], [JOINTS], axis=1)
        starts = np.diff(step, prepend=-1) != 0
        age = tick - tick[starts][np.cumsum(starts) - 1]
        ratio = np.nan_to_num(force_ratio(np.stack([tangential, normal], axis=1)))
        measured, at_impact = tick > 0, age < self._impact_ticks  # at tick 0 there is no force yet
        over, lost, late = measured & (ratio > self._friction_coeff), measured & (normal <= 0), measured & ~at_impact
        outside = [self._is_outside(place) for place in starts.nonzero()[0].tolist()]
        active, steps = Counter[str](), set[float]()
        for names, at in zip(self._active, step, strict=True):
            bounds = {name if name in ROWS else name[: 1 if name[0] == "u" else 2] for name in names}
            active.update(bounds)
            steps |= {at} if bounds & {*STONE_BARRIERS} else set()
        happened = {
            "ticks_over_cone": over & ~at_impact,
            "ticks_over_cone_at_impact": over & at_impact,
            "ticks_normal_force_negative": measured & (normal < 0),
            "ticks_lost": lost & ~at_impact,
            "ticks_lost_at_impact": lost & at_impact,
            "qp_unanswered_ticks": answered == 0,
            "qp_unconstrained_ticks": [not names for names in self._active],
            "slack_ticks": slack > SLACK_USED,
            "rescue_ticks": rescue > RESCUE_NEEDED,
            "saturated_ticks": saturated == 1,
            "ecbf_start_violations": outside,
        }
        counts = {name: int(np.sum(ticks)) for name, ticks in happened.items()}
        counts |= {f"active_{name}": active[name] for name in ROWS}
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
            least_barriers=least_by_name(dict(zip(names, B, strict=True)) for names, B, _ in self._barriers),
            max_force_ratio=ratio[late].max(initial=0.0),
            min_normal_force=normal[late].min() if late.any() else np.nan,
            barrier_active_steps=len(steps),
            max_torque=np.abs(torque).max(initial=0.0),
            rms_y=float(np.sqrt(y.mean())),
            rms_dy=float(np.sqrt(dy.mean())),
            max_clf=np.fmax.reduce(V, initial=0.0),
            max_slack=np.fmax.reduce(slack, initial=0.0),
            max_rescue_slack=np.fmax.reduce(rescue, initial=0.0),
            tick_ms_p50=float(np.percentile(milliseconds, 50)),
            tick_ms_p99=float(np.percentile(milliseconds, 99)),
            plant_ms_p50=float(np.median(plant_ticks)) * 1e3 if plant_ticks else np.nan,
            walk_seconds=walk_seconds,
            **counts,
        )
        when = {"tick": tick, "step": step, "ticks_since_landing": age, "at_impact": at_impact}
        columns = {**when, "tangential_force": tangential, "normal_force": normal, "ratio": ratio}
        violations = [
            ForceTick(run=self.run, kind="lost" if lost[i] else "over_cone", **{n: v[i] for n, v in columns.items()})
            for i in np.flatnonzero(over | lost)
        ]
        return RunResult(row=row, violations=violations, tick_seconds=[round(seconds, 7) for seconds in ticks])
