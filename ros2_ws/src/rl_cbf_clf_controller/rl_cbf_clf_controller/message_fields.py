"""From the fields of a `ControllerState` message to a `ControllerOutput`; any object with the message's fields will do.

No ROS here: a recording's reader uses it too. The way to the message is in `ros/messages.py`.
"""

from typing import Any

import numpy as np
from rabbit_description.state import Array, Leg

from rl_cbf_clf_controller.controller_output import ControllerOutput

ARRAYS = ("eta", "barriers", "barrier_rates", "mu", "mu_qp", "omega", "mu_held")
SCALARS = ("tick", "step_index", "step_time", "phase", "clf_slack", "rescue_slack", "saturated", "answered")
WORDS = ("solver", "status", "solve_seconds", "fault", "objective", "adaptation")
SAME = (*ARRAYS, *SCALARS, *WORDS)  # what has one name on both sides
# of more than one length
SEQUENCES = ("nominal_a", "nominal_b", "alpha", "beta", "observation", "identified", "adapted")
FINITE = ("eta", "mu", *SEQUENCES, "LgV")


def output_of(message: Any, torque: Array) -> ControllerOutput:
    """The output that a `ControllerState` tells of, with the `torque` (4,) from the command of its tick.

    Raises:
        ValueError: a value that is not finite, or lengths that do not fit the quantities.
    """
    n = len(message.quantities)
    values: dict[str, Any] = {name: getattr(message, name) for name in (*SCALARS, *WORDS)}
    values |= {name: np.array(getattr(message, name)) for name in (*ARRAYS, *SEQUENCES)}
    values["LgV"] = np.array(message.lgv)
    values["measured"] = np.array(getattr(message, "measured", np.full(n, np.nan)))  # not in the first recordings
    _check(values, n)
    for name in ("nominal_a", "alpha"):
        values[name] = values[name].reshape(-1, 4)
    return ControllerOutput(
        torque=torque,
        stance=Leg(message.stance),
        V=message.clf,
        quantities=tuple(message.quantities),
        active=tuple(message.active),
        policy_version=message.policy_version,
        **values,
    )


def _check(values: dict[str, Any], n: int) -> None:
    expected = {"nominal_a": 4 * n, "alpha": 4 * n, "nominal_b": n, "beta": n, "measured": n}
    lengths = {name: len(values[name]) for name in expected}
    if lengths != expected:
        raise ValueError(f"lengths {lengths}; {n} quantities expect {expected}")
    for name in FINITE:
        if not np.isfinite(values[name]).all():
            raise ValueError(f"{name} = {values[name]}; expected finite numbers")
