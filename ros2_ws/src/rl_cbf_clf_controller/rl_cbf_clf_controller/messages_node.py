"""`ControllerOutput` as the messages `TorqueCommand` and `ControllerState`, and back."""

from array import array
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from rabbit_description.state import Array, Leg
from rabbit_msgs.msg import ControllerState, TorqueCommand
from rabbit_ros.door import Refused, check_finite

from rl_cbf_clf_controller.controller import ControllerOutput

SAME = ("tick", "step_index", "step_time", "phase", "eta", "barriers", "barrier_rates", "mu", "mu_qp", "omega")
SAME_LATER = ("clf_slack", "rescue_slack", "saturated", "solver", "status", "answered", "solve_seconds", "fault")
SEQUENCES = ("nominal_a", "nominal_b", "alpha", "beta", "observation")
FINITE = ("eta", "mu", "nominal_a", "nominal_b", "alpha", "beta", "observation", "lgv")


def torque_message(output: ControllerOutput, episode: int, at: Time) -> TorqueCommand:
    """What the simulator needs."""
    return TorqueCommand(
        stamp=at,
        episode=episode,
        tick=output.tick,
        torque=output.torque,
        policy_version=output.policy_version,
        fault=output.fault[:128],
    )


def controller_state(output: ControllerOutput, episode: int, at: Time) -> ControllerState:
    """All but the torque."""
    message = ControllerState(stamp=at, episode=episode, stance=int(output.stance), clf=output.V, lgv=output.LgV)
    for name in (*SAME, *SAME_LATER):
        setattr(message, name, getattr(output, name))
    for name in SEQUENCES:
        setattr(message, name, array("d", getattr(output, name).tobytes()))
    message.quantities, message.active = list(output.quantities), [name[:32] for name in output.active[:64]]
    message.policy_version = output.policy_version
    return message


def output_of(message: ControllerState, torque: Array) -> ControllerOutput:
    """The inverse of both.

    Raises:
        Refused: a value that is not finite, or lengths that do not fit the quantities.
    """
    for name in FINITE:
        check_finite(name, getattr(message, name))
    n = len(message.quantities)
    lengths = {name: len(getattr(message, name)) for name in ("nominal_a", "alpha", "nominal_b", "beta")}
    if lengths != {"nominal_a": 4 * n, "alpha": 4 * n, "nominal_b": n, "beta": n}:
        raise Refused("wrong length", f"{lengths} for {n} quantities")
    values: dict[str, Any] = {name: getattr(message, name) for name in (*SAME, *SAME_LATER)}
    for name in ("eta", "barriers", "barrier_rates", "mu", "mu_qp", "omega", "nominal_b", "beta", "observation"):
        values[name] = np.array(getattr(message, name))
    return ControllerOutput(
        torque=torque,
        stance=Leg(message.stance),
        V=message.clf,
        LgV=np.array(message.lgv),
        quantities=tuple(message.quantities),
        active=tuple(message.active),
        nominal_a=np.array(message.nominal_a).reshape(n, 4),
        alpha=np.array(message.alpha).reshape(n, 4),
        policy_version=message.policy_version,
        **values,
    )
