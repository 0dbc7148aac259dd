"""The parameters of the trainer's node besides the training's, and the trainer that they ask for."""

import json

from pydantic import BaseModel, ConfigDict, Field
from rabbit_common.ros.parameters import ParameterError
from rl_cbf_clf_controller.policy import ZeroPolicy
from rl_cbf_clf_controller.weights import policy_path, read

from rl_trainer.parameters import TrainingParameters
from rl_trainer.training import Provenance, Trainer


class NodeParameters(BaseModel):
    """Parameters of the node besides the training's."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    plan_episodes: bool = Field(False, description="the simulator follows the plans: publish each one's policy")
    policy: str = Field(
        ZeroPolicy.version, description="to learn on from: zero (from scratch), the name of a shipped one, or a file"
    )
    folder: str = Field(
        "", description="folder for checkpoint and policies after each episode; it goes on from there, before `policy`"
    )
    plant: str = Field("{}", description="what the policy file says of the plant, JSON")


def make_trainer(training: TrainingParameters, own: NodeParameters) -> Trainer:
    """From scratch or from a policy; raises `ParameterError`, `PolicyFileError`."""
    try:
        plant = json.loads(own.plant)
    except ValueError as error:
        raise ParameterError(f"parameter plant = {own.plant!r}: not JSON: {error}") from error
    if not isinstance(plant, dict):
        raise ParameterError(f"parameter plant = {own.plant!r}: expected a JSON object")
    if own.policy == ZeroPolicy.version:
        return Trainer(training, Provenance(plant, command="trainer node"))
    policy = read(policy_path(own.policy), training.problem)
    trainer = Trainer(training, Provenance(plant, command=f"trainer node, from {policy.version}"))
    trainer.start_from(policy)
    return trainer
