"""From the fields of a `ControllerState` message to a `ControllerOutput`; any object with the message's fields will do.

No ROS here: a recording's reader uses it too. The way to the message is in messages_node.
"""

from typing import Any

import numpy as np
from rabbit_description.state import Array, Leg

from rl_cbf_clf_controller.controller import ControllerOutput

ARRAYS = (
    "eta",
    "barriers",
    "barrier_rates",
    "mu",
    "mu_qp",
    "omega",
    "mu_held",
)
SCALARS = ("tick", "step_index", "step_time", "phase", "clf_slack", "rescue_slack", "saturated", "answered")
WORDS = ("solver", "status", "solve_seconds", "fault", "objective", "adaptation")
SAME = (*ARRAYS, *SCALARS, *WORDS)  # what has one name on both sides
SEQUENCES = (
    "nominal_a",
    "nominal_b",
    "alpha",
    "beta",
    "observation",
    "identified",
    "adapted",
)  # of more than one length
FINITE = ("eta", "mu", *SEQUENCES, "lgv")


def output_of(message: Any, torque: Array) -> ControllerOutput:
    """The output that a `ControllerState` tells of, with the `torque` (4,) from the command of its tick.

    Raises:
        ValueError: a value that is not finite, or lengths that do not fit the quantities.
    """
    values: dict[str, Any] = {name: getattr(message, name) for name in (*SCALARS, *WORDS)}
    values |= {name: np.array(getattr(message, name)) for name in (*ARRAYS, *SEQUENCES)}
    _check(message, len(message.quantities))
    unmeasured = np.full(len(message.quantities), np.nan)  # as in recordings of former versions
    values["measured"] = np.array(getattr(message, "measured", unmeasured))
    for name in ("nominal_a", "alpha"):
        values[name] = values[name].reshape(-1, 4)
    return ControllerOutput(
        torque=torque,
        stance=Leg(message.stance),
        V=message.clf,
        LgV=np.array(message.lgv),
        quantities=tuple(message.quantities),
        active=tuple(message.active),
        policy_version=message.policy_version,
        **values,
    )


def _check(message: Any, n: int) -> None:
    expected = {"nominal_a": 4 * n, "alpha": 4 * n, "nominal_b": n, "beta": n}
    if hasattr(message, "measured"):
        expected["measured"] = n
    lengths = {name: len(getattr(message, name)) for name in expected}
    if lengths != expected:
        raise ValueError(f"lengths {lengths}; {n} quantities expect {expected}")
    for name in FINITE:
        if not np.isfinite(getattr(message, name)).all():
            raise ValueError(f"{name} = {getattr(message, name)}; expected finite numbers")
