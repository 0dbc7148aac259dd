"""One run in figures, taken tick by tick.

Forces are the true ones at the tick's beginning, the mean over the tick before, on the foot that stands. A landing
happens in the tick before the one that swaps the legs, so from the fourth tick of a step on the whole mean is more than
30 ms after the impact; earlier ticks are "at impact". A force violation is a later tick over the cone (with
F_N > 20 N) or without a push from the ground (F_N <= 0, "lost").
"""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict
from rabbit_description.force_ratio import LOADED
from rabbit_description.state import Array
from rabbit_sim.simulation import Landing, Outcome
from rl_cbf_clf_controller.controller_output import ControllerOutput
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_trainer.rollout import Record

from rabbit_experiments.walk_records import RESCUE_NEEDED

IMPACT_TICKS = 4  # of a step's beginning, whose mean force may hold some of the 30 ms after impact
ROWS = ("CLF", "B1", "B2", "C1", "C2", "u")  # of the QP, both cone rows as C2 and all saturation rows as u
EVENTS = (  # ticks and steps of a run that are counted
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
LARGEST = ("max_torque", "max_clf", "max_slack", "max_rescue_slack")
COUNTED = (*EVENTS, *(f"active_{name}" for name in ROWS))


class RunRow(BaseModel):
    """A row of runs.csv. Counts are ticks unless named otherwise; forces in N; times in s or ms."""

    model_config = ConfigDict(frozen=True)

    run: int
    seed: int
    outcome: str
    success: bool
    success_with_forces: bool
    stones: int
    missed_stones: int
    steps: int
    ticks: int
    worst_margin: float
    max_force_ratio: float
    min_normal_force: float
    ticks_over_cone: int
    ticks_over_cone_at_impact: int
    ticks_normal_force_negative: int
    ticks_lost: int
    ticks_lost_at_impact: int
    qp_unanswered_ticks: int
    qp_unconstrained_ticks: int
    slack_ticks: int
    rescue_ticks: int
    saturated_ticks: int
    ecbf_start_violations: int
    active_CLF: int
    active_B1: int
    active_B2: int
    active_C1: int
    active_C2: int
    active_u: int
    barrier_active_steps: int
    max_torque: float
    rms_y: float
    rms_dy: float
    max_clf: float
    max_slack: float
    max_rescue_slack: float
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


@dataclass
class ForceTally:
    """Stance forces against the unilateral constraint and the cone of `friction_coeff`; `counts` as in `RunRow`."""

    run: int
    friction_coeff: float
    violations: list[ForceTick] = field(default_factory=list)
    counts: Counter[str] = field(default_factory=Counter)
    max_ratio: float = 0.0
    min_normal: float = np.inf

    def add(self, output: ControllerOutput, age: int, force: Array) -> None:
        """Take in a tick, `age` ticks after the legs swapped, with the `force` (2,) on the foot that stands, N."""
        if output.tick == 0:
            return  # no tick before it, no force yet
        tangential, normal = force.tolist()
        ratio = abs(tangential) / normal if normal > LOADED else 0.0
        at_impact = age < IMPACT_TICKS
        if not at_impact:
            self.min_normal = min(self.min_normal, normal)
            self.max_ratio = max(self.max_ratio, ratio)
        self.counts["ticks_normal_force_negative"] += normal < 0
        if ratio <= self.friction_coeff and normal > 0:
            return
        kind: Literal["lost", "over_cone"] = "lost" if normal <= 0 else "over_cone"
        self.counts[f"ticks_{kind}" + "_at_impact" * at_impact] += 1
        self.violations.append(
            ForceTick(
                run=self.run,
                kind=kind,
                tick=output.tick,
                step=output.step_index,
                ticks_since_landing=age,
                at_impact=at_impact,
                tangential_force=tangential,
                normal_force=normal,
                ratio=ratio,
            )
        )


class RunTally:
    """Observes a rollout; `result` reduces it. `foot_force` gives the true forces, (2, 2), at the present tick."""

    def __init__(self, run: int, parameters: ControllerParameters, foot_force: Callable[[], Array]) -> None:
        self._foot_force = foot_force
        self.run = run
        self.ticks = 0
        self.fault = ""
        self._forces = ForceTally(run, parameters.friction_coeff)
        self._pole = parameters.barrier_pole_1
        self._eta: list[Array] = []
        self._torque: list[Array] = []
        self._sizes: list[tuple[float, ...]] = []  # V, CLF slack, rescue slack
        self._active: Counter[tuple[str, ...]] = Counter()
        self._counts: Counter[str] = Counter()
        self._barrier_steps: set[int] = set()
        self._step, self._step_tick = -1, 0

    def __call__(self, record: Record) -> None:
        """Take in a tick."""
        state, output = record.state, record.output
        self.ticks += 1
        self.fault = output.fault
        self._eta.append(output.eta)
        self._torque.append(output.torque)
        self._sizes.append((output.V, output.clf_slack, output.rescue_slack))
        self._active[output.active] += 1
        if output.step_index != self._step:
            self._step, self._step_tick = output.step_index, state.tick
            self._counts["ecbf_start_violations"] += self._starts_outside(output)
        self._forces.add(output, state.tick - self._step_tick, self._foot_force()[output.stance])
        self._count(output)

    def _starts_outside(self, output: ControllerOutput) -> bool:
        """Whether a barrier's B' + p1 B is negative where the step begins: from there an ECBF promises nothing."""
        return bool((output.barrier_rates + self._pole * output.barriers < 0).any())

    def _count(self, output: ControllerOutput) -> None:
        if "B1" in output.active or "B2" in output.active:
            self._barrier_steps.add(output.step_index)
        self._counts["qp_unanswered_ticks"] += not output.answered
        self._counts["qp_unconstrained_ticks"] += not output.active
        self._counts["slack_ticks"] += output.clf_slack > 0
        self._counts["rescue_ticks"] += output.rescue_slack > RESCUE_NEEDED
        self._counts["saturated_ticks"] += output.saturated

    def _counted(self) -> dict[str, int]:
        """`COUNTED`, of all ticks."""
        counts = self._counts + self._forces.counts
        for active, ticks in self._active.items():
            rows = {name if name in ROWS else name[: 1 if name[0] == "u" else 2] for name in active}
            counts.update({f"active_{name}": ticks for name in rows & set(ROWS)})
        return {name: counts[name] for name in COUNTED}

    def _most(self) -> dict[str, float]:
        """The largest of all ticks, 0 at least."""
        if not self.ticks:
            return dict.fromkeys(LARGEST, 0.0)
        sizes = np.column_stack([np.abs(self._torque).max(axis=1), self._sizes])
        return dict(zip(LARGEST, np.fmax.reduce(sizes, axis=0, initial=0.0).tolist(), strict=True))

    def _rms(self, of: slice) -> float:
        """Of the columns of eta."""
        squares = np.square(np.array(self._eta).reshape(-1, 8)).sum(axis=0)
        return float(np.sqrt(squares[of].mean() / max(self.ticks, 1)))

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
        missed = [landing.missed or not landing.on_stone for landing in landings]
        stones = missed.index(True) if True in missed else len(missed)
        success = outcome is Outcome.WALKED and not self.fault and not any(missed)
        forces, milliseconds = self._forces, np.array(ticks) * 1e3
        counts = self._counted()
        counted: dict[str, Any] = self._most() | counts
        row = RunRow(
            run=self.run,
            seed=seed,
            outcome=self.fault.split(":")[0] or outcome.value,
            success=success,
            success_with_forces=success and not counts["ticks_over_cone"] and not counts["ticks_lost"],
            stones=stones,
            missed_stones=sum(missed),
            steps=self._step + 1,
            ticks=self.ticks,
            worst_margin=min((min(step.l - step.l_min, step.l_max - step.l) for step in landings), default=np.nan),
            max_force_ratio=forces.max_ratio,
            min_normal_force=forces.min_normal if np.isfinite(forces.min_normal) else np.nan,
            barrier_active_steps=len(self._barrier_steps),
            rms_y=self._rms(slice(4)),
            rms_dy=self._rms(slice(4, 8)),
            tick_ms_p50=float(np.percentile(milliseconds, 50)),
            tick_ms_p99=float(np.percentile(milliseconds, 99)),
            plant_ms_p50=float(np.median(plant_ticks)) * 1e3 if plant_ticks else np.nan,
            walk_seconds=walk_seconds,
            **counted,
        )
        seconds = [round(tick, 7) for tick in ticks]
        return RunResult(row=row, violations=forces.violations, tick_seconds=seconds)
