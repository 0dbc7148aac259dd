"""What the controller publishes. The fields that tell of an output are in message_fields, with the way back."""

from array import array
from typing import Any

from rabbit_common.message_arrays import doubles
from rabbit_description.gait import Gaits
from rabbit_msgs.msg import ControllerSettings, ControllerState, LearnerTerms, RobotState, TorqueCommand

from rl_cbf_clf_controller.controller_output import ControllerOutput
from rl_cbf_clf_controller.message_fields import state_fields, terms_fields
from rl_cbf_clf_controller.parameters import ControllerParameters


def torque_message(output: ControllerOutput, answered: RobotState, sender: str) -> TorqueCommand:
    """What the simulator needs."""
    said = {"policy_version": output.policy_version, "fault": output.fault[:128]}
    return TorqueCommand(**_head(answered, sender), torque=doubles(output.torque), **said)


def controller_state(output: ControllerOutput, answered: RobotState, sender: str) -> ControllerState:
    """For a person: all but the torque and what only a learner needs."""
    return ControllerState(**_head(answered, sender), **state_fields(output))


def learner_terms(output: ControllerOutput, answered: RobotState, sender: str) -> LearnerTerms:
    """The rest."""
    return LearnerTerms(**_head(answered, sender), **terms_fields(output))


def fault_message(answered: RobotState, reason: str, version: str, sender: str) -> TorqueCommand:
    """In place of a state's torque: why its episode must end."""
    torque = array("d", bytes(8 * len(answered.applied)))
    return TorqueCommand(**_head(answered, sender), torque=torque, policy_version=version, fault=reason[:128])


def settings_message(p: ControllerParameters, gait: Gaits, turn: tuple[int, int], sender: str) -> ControllerSettings:
    """Parameters and gait that hold from `turn` on, episode and tick."""
    episode, tick = turn
    texts = {"parameters": p.model_dump_json(), "gait": gait.model_dump_json()}
    return ControllerSettings(episode=episode, tick=tick, sender=sender, **texts)


def _head(answered: RobotState, sender: str) -> dict[str, Any]:
    of_state = {"header": answered.header, "episode": answered.episode, "tick": answered.tick}
    return {**of_state, "sender": sender}
