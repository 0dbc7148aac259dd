"""A tick as a row of numbers: all that the page draws and plots. The layout is the same live, recorded and exported.

    maker = RowMaker(about)                  about: parameters that are drawn, see `walk_records.drawn_parameters`
    maker.columns                            the names, in the order of
    maker.row(record.state, record.output)   numbers, NaN where there is none

Lengths in m and in the world frame, forces in N, torques in N m, quantities and slacks in their units.
"""

import math
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from cbf_clf_qp.constraints import ResClf
from rabbit_description.force_ratio import force_ratio, impact_ticks
from rabbit_description.state import ACTUATED, JOINTS, TICK_SECONDS, Array, Leg

from rabbit_viewer.geometry import leg_points, links_of, torso_points

POINTS = ("hip", "head", "left_knee", "left_foot", "right_knee", "right_foot")
FIXED = (
    *("tick", "running", "events", "stance", "step", "touchdowns"),
    *(f"{point}_{axis}" for point in POINTS for axis in "xz"),
    *("stone_near", "stone_far", "stone_top", "F_T", "F_N", "force_ratio"),
    *("V", "V_bound", "clf_slack", "rescue_slack"),
    *(f"torque_{joint}" for joint in ACTUATED),
)
EVENTS = {"saturated": 1, "over_cone": 2, "pushed": 4, "swapped": 8}  # bits of the column `events`
ROUNDING = 1e-6  # N m
NUMBER = np.dtype("<f4")  # as the page reads it
LIMIT = re.compile(r"u\d+")  # the row of an input's limit


class RowMaker:
    """Makes the rows of one walker's ticks, in order; `quantities` names those that are estimated, `barriers` all B."""

    def __init__(
        self,
        about: Mapping[str, Any],
        quantities: Sequence[str],
        barriers: Sequence[str],
        knows_plant: bool = False,
        rows: Sequence[str] = (),
    ) -> None:
        """`knows_plant`: `row` is given the true errors; `rows` of the QP, of which each but an input's limit has its
        margin."""
        kinds = ("estimated", "measured", "true") if knows_plant else ("estimated", "measured")
        self._rows = [i for i, name in enumerate(rows) if not LIMIT.fullmatch(name)]
        margins = [f"margin_{rows[i]}" for i in self._rows]
        self.columns = (*FIXED, *barriers, *margins, *(f"{kind}_{name}" for kind in kinds for name in quantities))
        self._about, self._quantities, self._kinds = about, list(quantities), len(kinds)
        self._barriers = list(barriers)
        self._links = links_of(about)
        self._limits = tuple(float(about.get(name, math.nan)) for name in ("torque_limit", "friction_coeff"))
        self._decay, self._tick_seconds = clf_decay(about), float(about.get("tick_seconds", TICK_SECONDS))
        self._impact_ticks = impact_ticks(self._tick_seconds)
        # of the ticks before
        self._step = self._touchdowns = -1
        self._start = (0, math.nan)  # of the step: tick, V
        self._stone = (math.nan, math.nan, 0.0)
        self._last: tuple[int, Array, list[Array]] | None = None  # tick, nominal, errors

    def about(self, name: str) -> dict[str, Any]:
        """What the page needs to draw the rows."""
        names = {"columns": self.columns, "quantities": self._quantities, "barriers": self._barriers}
        return {**self._about, "name": name, **names}

    @np.errstate(all="ignore")
    def row(self, state: Any, output: Any, events: int = 0, true: Array | None = None) -> list[float]:
        """The row of a tick; `state` and `output` have the fields of `RobotState` and `ControllerOutput`.

        What is too large to compute with is infinite or NaN. `true`: the errors (n,) of the nominal quantities at this
        tick, by the plant's model. `estimated_*`, `measured_*` and `true_*` are the errors over the tick before.
        """
        q = state.q[None]
        points = np.concatenate([torso_points(q)[0], *(leg_points(q, leg, self._links)[0, 1:] for leg in Leg)])
        foot = points[3 + 2 * output.stance]
        self._begin_step(state, output, float(foot[0]))
        force = state.foot_force[output.stance]
        ratio = float(force_ratio(force))
        bound = self._start[1] * float(np.exp(-self._decay * (state.tick - self._start[0]) * self._tick_seconds))
        events |= self._events(state.tick, output, ratio)
        return [
            *(float(state.tick), 1.0, float(events)),
            *(float(output.stance), float(output.step_index), float(state.touchdowns)),
            *points.ravel().tolist(),
            *(*self._stone, *force.tolist(), ratio),
            *(output.V, bound, output.clf_slack, output.rescue_slack),
            *output.torque.tolist(),
            *output.barriers.tolist(),
            *(output.margins[self._rows].tolist() if self._rows else ()),
            *self._errors(state.tick, output, [] if true is None else [true]),
        ]

    def _begin_step(self, state: Any, output: Any, foot: float) -> None:
        if output.step_index != self._step:
            self._step, self._start = output.step_index, (state.tick, output.V)
        if state.touchdowns != self._touchdowns:  # a stone lies where it was seen first: the standing foot rolls
            self._touchdowns = state.touchdowns
            seen = state.preview
            top = self._stone[2] + (seen.height if seen else 0.0)  # as it was previewed
            self._stone = (foot + seen.l_min, foot + seen.l_max, top) if seen else (math.nan, math.nan, top)

    def _events(self, tick: int, output: Any, ratio: float) -> int:
        limit, cone = self._limits
        is_over = ratio > cone and tick - self._start[0] >= self._impact_ticks
        is_saturated = bool(np.abs(output.torque).max() > limit - ROUNDING)
        return EVENTS["saturated"] * is_saturated | EVENTS["over_cone"] * is_over

    def _errors(self, tick: int, output: Any, true: list[Array]) -> list[float]:
        nominal = output.nominal_a @ output.mu + output.nominal_b
        estimated = output.alpha @ output.mu + output.beta
        last, self._last = self._last, (tick, nominal, [estimated, *true])
        if last is None or last[0] != tick - 1:
            return [math.nan] * (len(self._quantities) * self._kinds)
        estimated, *true = last[2]
        return np.concatenate([estimated, output.measured - last[1], *true]).tolist()


def packed(rows: Sequence[float]) -> bytes:
    """Rows of `NUMBER`; a number beyond float32 is infinite there, and is not drawn."""
    with np.errstate(over="ignore"):
        return np.asarray(rows, dtype=NUMBER).tobytes()


def clf_decay(about: Mapping[str, Any]) -> float:
    """The rate at which V must fall where no slack is used, 1/s; NaN where the gains are not known."""
    if not {"eps", "kp", "kd"} <= about.keys():
        return math.nan
    return float(ResClf(JOINTS, float(about["eps"]), (about["kp"], about["kd"])).rate)
