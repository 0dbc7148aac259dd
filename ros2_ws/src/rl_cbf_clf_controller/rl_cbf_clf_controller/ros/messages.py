"""`ControllerOutput` as `TorqueCommand` and `ControllerState`; the way back is in message_fields."""

from typing import Any

from builtin_interfaces.msg import Time
from rabbit_msgs.msg import ControllerState, TorqueCommand

from rl_cbf_clf_controller.controller_output import ControllerOutput
from rl_cbf_clf_controller.message_fields import SAME, SEQUENCES

_AS_THEY_ARE = {*SAME, "policy_version"} - {"fault", "status"}


def torque_message(output: ControllerOutput, episode: int, at: Time, sender: str) -> TorqueCommand:
    """What the simulator needs."""
    return TorqueCommand(
        stamp=at,
        episode=episode,
        tick=output.tick,
        torque=output.torque,
        policy_version=output.policy_version,
        fault=output.fault[:128],
        sender=sender,
    )


def controller_state(output: ControllerOutput, episode: int, at: Time, sender: str) -> ControllerState:
    """All but the torque; texts that may be too long for the message are cut."""
    same: dict[str, Any] = {name: getattr(output, name) for name in _AS_THEY_ARE}
    same |= {name: getattr(output, name).ravel() for name in (*SEQUENCES, "measured")}
    return ControllerState(
        stamp=at,
        episode=episode,
        stance=int(output.stance),
        clf=output.V,
        lgv=output.LgV,
        quantities=list(output.quantities),
        active=[name[:32] for name in output.active[:64]],
        fault=output.fault[:128],
        status=output.status[:64],
        sender=sender,
        **same,
    )
