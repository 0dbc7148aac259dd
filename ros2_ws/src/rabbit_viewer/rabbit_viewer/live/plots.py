"""The values that are plotted, as JSON, with their schema. A value that is not there, as a barrier on flat ground, is
left out."""

import math
from typing import Any

from rabbit_description.force_ratio import force_ratio
from rabbit_description.state import ACTUATED

from rabbit_viewer.live.snapshot import Snapshot

NAMES = ("episode", "tick", "time", "V", "B1", "B2", "clf_slack", "rescue_slack", "F_T", "F_N", "force_ratio")
JOINTS = tuple(f"torque_{joint}" for joint in ACTUATED)
PLOTTED = (*NAMES, "friction_coeff", *JOINTS)
SCHEMA: dict[str, Any] = {"type": "object", "properties": {name: {"type": "number"} for name in PLOTTED}}


def plotted(snapshot: Snapshot) -> dict[str, float]:
    """Values by name; SI units. Torques are those that acted over the tick before."""
    state, details, force = snapshot.state, snapshot.details, snapshot.force
    values = (
        *(state.episode, state.tick, snapshot.seconds, details.clf, *details.barriers),
        *(details.clf_slack, details.rescue_slack, *force, force_ratio(force)),
        snapshot.limits.friction_coeff if snapshot.limits else math.nan,
        *state.applied,
    )
    named = {name: float(value) for name, value in zip(PLOTTED, values, strict=True)}
    return {name: value for name, value in named.items() if math.isfinite(value)}
