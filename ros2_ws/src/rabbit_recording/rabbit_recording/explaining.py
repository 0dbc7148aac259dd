"""A tick explained: the programme, of a recorded one by replay, and what changed since the tick before."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from cbf_clf_qp.tick import Tick
from rl_cbf_clf_controller.explanation import Explanation, Words, changes, explain
from rl_trainer.rollout import Moment, Record
from rl_trainer.task_episode import Ride

from rabbit_recording import RecordingError
from rabbit_recording.checking import replayed
from rabbit_recording.open_recording import one_line_errors
from rabbit_recording.reader import last_episode

INPUTS = "stance hip", "stance knee", "swing hip", "swing knee"
WORDS = {  # of RABBIT's rows: what they are for, and the unit of what they constrain
    "CLF": ("follow the gait", "rad²/s³"),
    "B1": ("land before the far edge", "m/s²"),
    "B2": ("land past the near edge", "m/s²"),
    "C1": ("press on the ground", "N"),
    "C2": ("friction", "N"),
    "C2+": ("friction, ground pushing forward", "N"),
    "C2-": ("friction, ground pushing back", "N"),
    **{f"u{i + 1}": (f"{name}'s torque", "N m") for i, name in enumerate(INPUTS)},
}
ROUNDING = 1e-6  # N m, that processors differ by
LEGS = "left", "right"


@dataclass(frozen=True)
class ExplainedTick:
    """A tick: which one, what answered it, why it decided so, and what changed since the tick before.

    `words`, `inputs`: what the task calls its rows, with their units, and its inputs.
    """

    title: str
    answered: str
    explanation: Explanation
    changed: list[str]
    words: Words | None = None
    inputs: Sequence[str] = ()

    def lines(self) -> list[str]:
        """All of it in words."""
        told = [self.title, self.answered, "", *self.explanation.lines(self.words), "", "Since the tick before:"]
        return [*told, *(f"  {line}" for line in self.changed)]


def explained(programme: Tick, moments: Mapping[int, Any], tick: int) -> tuple[Explanation, Explanation | None]:
    """Explains a tick, and the one before if there is one. The next may be a `Record`: it says what was measured."""

    def of(k: int) -> Explanation:
        now, after = moments[k], moments.get(k + 1)
        measured = after.output.measured if after and after.output.measured.size else None
        return explain(programme, now.x, now.p, now.estimates, now.decided, measured)

    return of(tick), of(tick - 1) if tick - 1 in moments else None


def explain_walk(
    of: str, programme: Tick, moments: Mapping[int, Any], tick: int, tick_seconds: float, is_set: bool = False
) -> ExplainedTick:
    """A tick of RABBIT's; `of`: of what; `is_set`: parameters changed in it. Raises ValueError: no solver answered."""
    now, before = explained(programme, moments, tick)
    output = moments[tick].output
    where = f"step {output.step_index}, on the {LEGS[output.stance]} leg for {output.step_time:.2f} s"
    title = f"{of}, tick {tick} ({tick * tick_seconds:.2f} s): {where}"
    noise = "; exploration was added to this answer" * bool(output.omega.any())
    answered = f"policy {output.policy_version}, answered by {output.solver}{noise}"
    changed = ["it is the first"]
    if before:
        changed = [*what_changed(moments[tick - 1], moments[tick]), *["parameters changed"] * is_set]
        changed = [*changed, *changes(before, now)] or ["no row, no leg, no contact changed"]
    return ExplainedTick(title, answered, now, changed, WORDS, INPUTS)


def what_changed(was: Record, now: Record) -> list[str]:
    """The contacts, stance leg, policy and stone that differ between two of RABBIT's ticks, in words."""
    changed = [
        f"the {LEGS[leg]} foot {'touches' if now.state.contact[leg] else 'leaves'} the ground"
        for leg in np.flatnonzero(was.state.contact != now.state.contact)
    ]
    if was.output.stance != now.output.stance:
        changed.append(f"the robot stands on the {LEGS[now.output.stance]} leg")
    if was.output.policy_version != now.output.policy_version:
        changed.append(f"policy {now.output.policy_version}")
    if was.state.preview != now.state.preview:
        changed.append("another stone is seen")
    return changed


def worst_of(records: Mapping[int, Record]) -> int:
    """The tick whose slacks of last resort are largest in all."""
    return max(records, key=lambda k: np.nan_to_num(records[k].output.rescue_slack, nan=-1.0))


def explain_tick(path: Path, tick: int | None = None, number: int | None = None) -> ExplainedTick:
    """Explain a recorded tick of episode `number`, by default of the last with ticks; the worst, where none is named.

    Raises:
        RecordingError: as `iterate_episodes`; no such tick, or one that cannot be replayed.
    """
    episode = last_episode(path, number)
    records: dict[int, Record] = {record.state.tick: record for record in episode.records}
    tick = worst_of(records) if tick is None else tick
    here = f"recording {path}: tick {tick} of episode {episode.number}"
    if tick not in records:
        raise RecordingError(f"{here}: expected one that was recorded, {episode.first} to {episode.last}")
    if not records[tick].output.quantities:
        raise RecordingError(f"{here}: its controller publishes no controller_state")
    if missing := [k for k in range(tick) if k not in records]:
        raise RecordingError(f"{here}: a replay needs all ticks before it, but tick {missing[0]} is missing")
    with one_line_errors(path, f"tick {tick} of episode {episode.number} cannot be explained"):
        wanted = replace(episode, records=[records[k] for k in range(tick + 1)])
        for k, (controller, output) in enumerate(replayed(wanted)):
            if k >= tick - 1:
                if (off := np.abs(output.torque - records[k].output.torque).max()) > ROUNDING:
                    raise RecordingError(f"{here}: its replay is off by {off:.3g} N m in tick {k}")
                records[k] = Moment.of(controller, records[k])
        is_set = tick in [settings.tick for settings in episode.settings]
        of, seconds = f"episode {episode.number}", episode.tick_seconds
        return explain_walk(of, controller.qp, records, tick, seconds, is_set)


def explain_ride(ride: Ride, tick: int | None = None) -> ExplainedTick:
    """A tick of a ride; the worst, where none is named. Raises ValueError where there is nothing to explain."""
    moments = dict(enumerate(ride.moments))
    tick = worst_of(moments) if tick is None else tick
    if tick not in moments:
        raise ValueError(f"tick {tick} of {ride.controller}: expected one from 0 to {len(moments) - 1}")
    if (decided := moments[tick].decided) is None:
        raise ValueError(f"tick {tick} of {ride.controller}: it has no QP")
    now, before = explained(ride.task.tick, moments, tick)
    changed = changes(before, now) or ["no row changed"] if before else ["it is the first"]
    title = f"{ride.task.name}, {ride.controller}, tick {tick} ({moments[tick].output.step_time:.2f} s)"
    return ExplainedTick(title, f"answered by {decided.solver}", now, changed)
