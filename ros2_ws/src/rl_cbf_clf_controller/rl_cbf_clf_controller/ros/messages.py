"""What the controller publishes. The fields that tell of an output are in message_fields, with the way back."""

from array import array

from rabbit_common.message_arrays import doubles
from rabbit_description.gait import Gaits
from rabbit_msgs.msg import ControllerSettings, ControllerState, LearnerTerms, PolicySwap, RobotState, TorqueCommand

from rl_cbf_clf_controller.controller_output import ControllerOutput
from rl_cbf_clf_controller.message_fields import state_fields, terms_fields
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.ros.policy_loader import CheckedPolicy


def torque_message(output: ControllerOutput, answered: RobotState, sender: str) -> TorqueCommand:
    """What the simulator needs."""
    return TorqueCommand(
        header=answered.header,
        episode=answered.episode,
        tick=answered.tick,
        torque=doubles(output.torque),
        policy_version=output.policy_version,
        fault=output.fault[:128],
        sender=sender,
    )


def controller_state(output: ControllerOutput, answered: RobotState, sender: str) -> ControllerState:
    """For a person: all but the torque and what only a learner needs."""
    of = {"header": answered.header, "episode": answered.episode, "tick": answered.tick, "sender": sender}
    return ControllerState(**of, **state_fields(output))


def learner_terms(output: ControllerOutput, answered: RobotState, sender: str) -> LearnerTerms:
    """The rest."""
    of = {"header": answered.header, "episode": answered.episode, "tick": answered.tick, "sender": sender}
    return LearnerTerms(**of, **terms_fields(output))


def fault_message(message: RobotState, reason: str, version: str, sender: str) -> TorqueCommand:
    """In place of a state's torque: why its episode must end."""
    where = {name: getattr(message, name) for name in ("header", "episode", "tick")}
    torque = array("d", bytes(8 * len(message.applied)))
    return TorqueCommand(**where, torque=torque, policy_version=version, fault=reason[:128], sender=sender)


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
