"""A recorded tick, explained: the controller's programme by replay, and what changed since the tick before."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rabbit_description.state import TICK_SECONDS, Array
from rl_cbf_clf_controller.explanation import Explanation, Words, changes, explain
from rl_trainer.rollout import Record

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


Explained = tuple[Record, Explanation]


def measured_over(after: Record | None) -> Array | None:
    """The quantities (k,) over a tick, as the tick `after` it measured them; None where it did not."""
    return None if after is None or not after.output.measured.size else after.output.measured


def explained_tick(
    of: str, now: Explained, before: Explained | None, is_set: bool = False, tick_seconds: float = TICK_SECONDS
) -> ExplainedTick:
    """RABBIT's tick `now` and the one `before`; `of`: of what a tick; `is_set`: parameters changed in it."""
    output = now[0].output
    where = f"step {output.step_index}, on the {LEGS[output.stance]} leg for {output.step_time:.2f} s"
    title = f"{of}, tick {output.tick} ({output.tick * tick_seconds:.2f} s): {where}"
    noise = "; exploration was added to this answer" * bool(output.omega.any())
    answered = f"policy {output.policy_version}, answered by {output.solver}{noise}"
    changed = changes_of(before, now, is_set) if before else ["it is the first"]
    return ExplainedTick(title, answered, now[1], changed, WORDS, INPUTS)


def changes_of(before: Explained, now: Explained, is_set: bool) -> list[str]:
    """What is another in RABBIT's tick than in the one before."""
    (was, _), (record, _) = before, now
    feet = [
        f"the {LEGS[leg]} foot {'touches' if record.state.contact[leg] else 'leaves'} the ground"
        for leg in np.flatnonzero(was.state.contact != record.state.contact)
    ]
    told = [f"the robot stands on the {LEGS[record.output.stance]} leg"] * (was.output.stance != record.output.stance)
    told += [f"policy {record.output.policy_version}"] * (was.output.policy_version != record.output.policy_version)
    told += ["another stone is seen"] * (was.state.preview != record.state.preview)
    told += ["parameters changed"] * is_set
    return [*feet, *told, *changes(before[1], now[1])] or ["no row, no leg, no contact changed"]


def explain_tick(path: Path, tick: int | None = None, number: int | None = None) -> ExplainedTick:
    """Explain a tick of episode `number`, by default of the last with ticks; the worst, where none is named.

    The worst is the one whose slacks of last resort are largest in all.

    Raises:
        RecordingError: as `iterate_episodes`; no such tick, or one that cannot be replayed.
    """
    episode = last_episode(path, number)
    records = {record.state.tick: record for record in episode.records}
    if tick is None:
        tick = max(records, key=lambda k: np.nan_to_num(records[k].output.rescue_slack, nan=-1.0))
    here = f"recording {path}: tick {tick} of episode {episode.number}"
    if tick not in records:
        raise RecordingError(f"{here}: expected one that was recorded, {episode.first} to {episode.last}")
    if not records[tick].output.quantities:
        raise RecordingError(f"{here}: its controller publishes no controller_state")
    if missing := [k for k in range(tick) if k not in records]:
        raise RecordingError(f"{here}: a replay needs all ticks before it, but tick {missing[0]} is missing")
    explained = list[Explained]()
    with one_line_errors(path, f"tick {tick} of episode {episode.number} cannot be explained"):
        wanted = replace(episode, records=[records[k] for k in range(tick + 1)])
        for record, (controller, output) in zip(wanted.records, replayed(wanted), strict=True):
            if output.tick >= tick - 1:
                scene, off = controller.scene, np.abs(output.torque - record.output.torque).max()
                if off > ROUNDING:
                    raise RecordingError(f"{here}: its replay is off by {off:.3g} N m in tick {output.tick}")
                decided = controller.qp, scene.x, scene.p, controller.estimates, controller.decided
                explained.append((record, explain(*decided, measured_over(records.get(output.tick + 1)))))
    *before, now = explained
    is_set, last = tick in [settings.tick for settings in episode.settings], before[0] if before else None
    return explained_tick(f"episode {episode.number}", now, last, is_set, episode.tick_seconds)
