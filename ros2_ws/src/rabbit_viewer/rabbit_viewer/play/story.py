"""What the page says: before a walk what will be seen, at a fall what happened, then what to try next."""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from rabbit_description.state import TICK_SECONDS
from rabbit_experiments.walk_records import CONTROLLERS
from rabbit_recording.explaining import WORDS
from rabbit_sim.simulation import Landing
from rl_cbf_clf_controller.explanation import BROKEN, number
from rl_trainer.rollout import Record

from rabbit_viewer.geometry import stands
from rabbit_viewer.play.settings import NOBODY, YOURS, PlaySettings, Start

WHO = {  # what each robot does with the difference between its model and itself
    "best": "identifies its masses as it walks",
    "tuned": "trusts its model, at the best gain",
    "learned": "corrects its model by a network that learned at twice the mass",
    "nominal": "trusts its model, with the paper's gain",
    "identified": "identifies its masses as it walks, with the paper's speed",
    "oracle": "is told exactly how wrong its model is",
    "l1": "adapts its model, and sees no stones",
}
TIMES = {0.5: "half of what", 2.0: "twice what", 3.0: "three times what"}
PUSH = {"text": "Push them", "do": {"do": "push", "force": 200, "seconds": 0.1}}
WHY = {"text": "Why did it fall?", "do": {"do": "explain"}}


def title_of(name: str, start: Start) -> str:
    """A robot's name and what it does."""
    who = start.yours.name if name == YOURS and start.yours else WHO.get(name)
    who = who or CONTROLLERS.get(name, "a controller of your own")
    return f"{name}: {who}"


def opening(start: Start, settings: PlaySettings) -> str:
    """One sentence: which plant, which robots."""
    names = [name for name in (settings.first, settings.second) if name != NOBODY]
    both, s, belief = "The robot", "s", "it believes"
    if names[1:]:
        both, s, belief = "Both robots", "", "their controllers believe"
    differences = []
    if settings.mass_scale != 1:
        times = TIMES.get(settings.mass_scale, f"{settings.mass_scale:g} times what")
        differences.append(f"weigh{s} {times} {belief}")
    if settings.payload:
        differences.append(f"carr{'ies' if s else 'y'} {settings.payload:g} kg of which no model knows")
    if settings.slope:
        differences.append(f"walk{s} {'up' if settings.slope > 0 else 'down'} {abs(settings.slope):g}° unawares")
    if settings.motor_power != 1:
        differences.append(f"{'has' if s else 'have'} motors of {settings.motor_power:.0%} power")
    said = " and ".join(differences) or f"walk{s} as {belief}"
    return f"{both} {said}: " + "; ".join(title_of(name, start).replace(": ", " ", 1) for name in names) + "."


def next_things(settings: PlaySettings) -> list[dict[str, Any]]:
    """Three things to try, as what the page asks for: a push, another robot, why it fell."""
    mass = 0.5 if settings.mass_scale > 1 else 3.0
    text = "Half the mass" if mass < 1 else "3 times the mass"
    return [WHY, {"text": text, "do": {"do": "begin", "settings": {"mass_scale": mass}}}, PUSH]


def why_it_fell(
    name: str, outcome: str, kept: Sequence[Record], landings: Sequence[Landing], tick_seconds: float = TICK_SECONDS
) -> dict[str, Any]:
    """Which row was not kept, in words (`reason`), and the `tick` in which the model was furthest from the robot.

    The row: B1 or B2 where the foot came down off its stone, C1 where both feet left the ground, else the CLF's. By the
    model the QP keeps it, or nearly; what the robot does in the same tick is measured.
    """
    missed = landings[-1] if landings and landings[-1].missed else None
    off = 0.0
    row, quantity, sign = "CLF", "V", -1
    if missed:
        row = quantity = "B1" if missed.l > missed.l_max else "B2"
        sign, off = 1, max(missed.l - missed.l_max, missed.l_min - missed.l)
    elif outcome == "flight":
        row, quantity, sign = "C1", "C1", 1
    last = max((tick.output.step_index for tick in kept if stands(tick.state.q[None])), default=0) - bool(missed)
    broken = [
        (sign * (promised(tick, quantity) - measured(after, quantity)), tick, after)
        for tick, after in pairwise(kept)
        if stands(tick.state.q[None])
        and tick.output.step_index == after.output.step_index == last
        and row in tick.output.rows
        and quantity in tick.output.quantities
    ]
    walked = max((tick.state.touchdowns for tick in kept), default=0)
    where = f"{name} fell {f'after {walked} stone' + 's' * (walked > 1) if walked else 'at the first stone'}"
    if not (broken := [entry for entry in broken if np.isfinite(entry[0])]):
        return {"reason": f"{where}."}
    _, tick, after = max(broken, key=lambda entry: entry[0])
    (meaning, unit), was, did = WORDS[row], promised(tick, quantity), measured(after, quantity)
    said = f"its model promised {number(was)} {unit}, {number(did)} was measured"
    if row == "CLF":
        fall, rose = (f"{'fall' if value < 0 else 'rise'} by {number(abs(value))}" for value in (was, did))
        rose = rose.replace("rise", "rose").replace("fall", "fell")
        said = f"by its model V, how far it is from its gait, was to {fall} {unit}; as measured it {rose}"
    in_model = "gave way too" if tick.output.slacks[tick.output.rows.index(row)] > BROKEN else "was kept"
    side = "past the far edge" if row == "B1" else "short of the near edge"
    cause = f": its foot came down {off * 1000:.0f} mm {side} of stone {walked + 1}" if missed else ""
    when = f"at {tick.output.tick * tick_seconds:.2f} s"
    said = f"{when} {said}, {number(abs(did - was))} off. In the model it {in_model}"
    reason = f"{where}{cause}. It could not keep the row {row}, “{meaning}”: {said}."
    return {"reason": reason, "tick": tick.output.tick}


def promised(tick: Record, name: str) -> float:
    """A quantity over the tick as the controller computed it, by its model and its estimates."""
    i, output = tick.output.quantities.index(name), tick.output
    return float((output.nominal_a[i] + output.alpha[i]) @ output.mu + output.nominal_b[i] + output.beta[i])


def measured(after: Record, name: str) -> float:
    """A quantity over the tick before."""
    return float(after.output.measured[after.output.quantities.index(name)])
