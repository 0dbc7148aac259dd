"""The values that are plotted, as JSON, with their schema. A value that is not there, as a barrier on flat ground, is
left out."""

import math
from typing import Any

from rabbit_description.force_ratio import force_ratio
from rabbit_description.state import ACTUATED

from rabbit_viewer.live.snapshot import Limits, Snapshot

NAMES = ("episode", "tick", "time", "V", "B1", "B2", "clf_slack", "rescue_slack", "F_T", "F_N", "force_ratio")
JOINTS = tuple(f"torque_{joint}" for joint in ACTUATED)
PLOTTED = (*NAMES, "friction_coeff", *JOINTS)
SCHEMA: dict[str, Any] = {"type": "object", "properties": {name: {"type": "number"} for name in PLOTTED}}


def plotted(moment: Snapshot, limits: Limits | None) -> dict[str, float]:
    """Values by name; SI units."""
    tangential, normal = (float(value) for value in moment.force)
    values: dict[str, float] = {
        "episode": moment.episode,
        "tick": moment.tick,
        "time": moment.seconds,
        "V": float(moment.V),
        "B1": float(moment.barriers[0]),
        "B2": float(moment.barriers[1]),
        "clf_slack": float(moment.clf_slack),
        "rescue_slack": float(moment.rescue_slack),
        "F_T": tangential,
        "F_N": normal,
        "force_ratio": float(force_ratio(moment.force)),
        "friction_coeff": limits.friction_coeff if limits else math.nan,
        **dict(zip(JOINTS, moment.torque.tolist(), strict=True)),
    }
    return {name: value for name, value in values.items() if math.isfinite(value)}
