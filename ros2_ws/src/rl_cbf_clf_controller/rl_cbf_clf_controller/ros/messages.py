"""`ControllerOutput` as the messages `TorqueCommand` and `ControllerState`; the way back is in message_fields."""

from array import array

from builtin_interfaces.msg import Time
from rabbit_msgs.msg import ControllerState, TorqueCommand

from rl_cbf_clf_controller.controller import ControllerOutput
from rl_cbf_clf_controller.message_fields import SAME, SEQUENCES


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
    for name in set(SAME) - {"fault", "status"}:  # texts may be too long for the message
        setattr(message, name, getattr(output, name))
    for name in (*SEQUENCES, "measured"):
        setattr(message, name, array("d", getattr(output, name).tobytes()))
    message.quantities, message.active = list(output.quantities), [name[:32] for name in output.active[:64]]
    message.policy_version, message.fault, message.status = (
        output.policy_version,
        output.fault[:128],
        output.status[:64],
    )
    return message
