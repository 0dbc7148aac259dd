"""What the controller tells of a tick beside the torque. The fields of an output, and the way back: message_fields."""

from typing import Any

from rabbit_msgs.msg import ControllerState, LearnerTerms, RobotState

from rl_cbf_clf_controller.controller_output import ControllerOutput
from rl_cbf_clf_controller.message_fields import state_fields, terms_fields


def controller_state(output: ControllerOutput, answered: RobotState, sender: str) -> ControllerState:
    """For a person: all but the torque and what only a learner needs."""
    return ControllerState(**head(answered, sender), **state_fields(output))


def learner_terms(output: ControllerOutput, answered: RobotState, sender: str) -> LearnerTerms:
    """The rest."""
    return LearnerTerms(**head(answered, sender), **terms_fields(output))


def head(answered: RobotState, sender: str) -> dict[str, Any]:
    """What both begin with."""
    of_state = {"header": answered.header, "episode": answered.episode, "tick": answered.tick}
    return {**of_state, "sender": sender}
