"""What the controller publishes. The way from a `ControllerState` back to a `ControllerOutput` is in message_fields."""

from array import array
from typing import Any

import numpy as np
from builtin_interfaces.msg import Time
from rabbit_description.gait import Gaits
from rabbit_description.state import Array
from rabbit_msgs.msg import ControllerSettings, ControllerState, PolicySwap, RabbitState, TorqueCommand

from rl_cbf_clf_controller.controller_output import ControllerOutput
from rl_cbf_clf_controller.message_fields import SAME, SEQUENCES
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.ros.policy_loader import CheckedPolicy

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
    same |= {name: doubles(getattr(output, name)) for name in (*SEQUENCES, "measured")}
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


def doubles(values: Array) -> bytes:
    """For a sequence of a message: copied at once, where rclpy would ask an array for each number."""
    return np.asarray(values, dtype=np.float64).tobytes()


def fault_message(message: RabbitState, reason: str, version: str, sender: str) -> TorqueCommand:
    """In place of a state's torque: why its episode must end."""
    where = {name: getattr(message, name) for name in ("stamp", "episode", "tick")}
    return TorqueCommand(**where, policy_version=version, fault=reason[:128], sender=sender)


def swap_message(checked: CheckedPolicy, turn: tuple[int, int], sender: str) -> PolicySwap:
    """A policy that is in force since `turn`, episode and tick, or was refused then."""
    return PolicySwap(
        episode=max(turn[0], 0),
        tick=max(turn[1], 0),
        version=checked.version,
        source=checked.source[-128:],
        accepted=checked.policy is not None,
        reason=checked.reason,
        data=array("B", checked.data),
        sender=sender,
    )


def settings_message(p: ControllerParameters, gait: Gaits, turn: tuple[int, int], sender: str) -> ControllerSettings:
    """Parameters and gait that hold from `turn` on, episode and tick."""
    episode, tick = turn
    texts = {"parameters": p.model_dump_json(), "gait": gait.model_dump_json()}
    return ControllerSettings(episode=episode, tick=tick, sender=sender, **texts)
