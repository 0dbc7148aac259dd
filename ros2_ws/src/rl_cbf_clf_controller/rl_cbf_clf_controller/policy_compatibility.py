"""Which policy file fits which controller, and as what.

A policy fits the controller of the problem it was trained for. One for stones fits flat ground too: it is shown the
stone in whose middle the gait's own step ends, and of its estimates those of V and of the outputs are taken, which are
all that a controller without barriers and force rows has a use for.
"""

import numpy as np
from cbf_clf_qp.estimates import Estimates
from rabbit_description.gait import Gait, Gaits
from rabbit_description.state import Array

from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_cbf_clf_controller.policy import ActorPolicy, LearnedPolicy, Policy
from rl_cbf_clf_controller.step_outputs import has_lengths
from rl_cbf_clf_controller.uncertainty import RL_CBF_CLF_QP, RL_CLF_QP, STEP_LENGTH
from rl_cbf_clf_controller.weights import PolicyFile, PolicyFileError

STONE_WIDTH = 0.05  # m, of the stones that the paper trains on


class OnFlatGround(LearnedPolicy):
    """A policy for stones where there are none; `step_length` is the gait's, m."""

    def __init__(self, policy: LearnedPolicy, step_length: float) -> None:
        self.version, self.adaptation = policy.version, policy.adaptation
        self._policy = policy
        self._stone = np.array([step_length - STONE_WIDTH / 2, step_length])

    def act(self, observation: Array, LgV: Array) -> Estimates:
        """The policy's estimates of V and of the outputs."""
        whole = self._policy.act(np.append(observation, self._stone), LgV)
        return Estimates(whole.alpha[:1], whole.beta[:1], whole.output_error)


def fitted(file: PolicyFile, law: ControllerParameters, gaits: Gaits) -> Policy:
    """The policy of a file for a controller with these parameters and this gait or library.

    Raises:
        PolicyFileError: it was trained for another problem, beside another adaptation, or reads the length of a gait
            library's steps on stones and there is one gait.
    """
    own = file.metadata.adaptation or "none"
    if own != law.adaptation:
        raise PolicyFileError(f"policy: it was trained with adaptation {own}; this controller has {law.adaptation}")
    policy, trained_for = ActorPolicy(file), file.metadata.problem
    if file.metadata.fits(law.problem):
        if law.terrain == "stones" and STEP_LENGTH in file.metadata.observation and not has_lengths(gaits):
            raise PolicyFileError(f"policy: it reads {STEP_LENGTH}: expected a gait library, gait is {gaits.name}")
        return policy
    if (trained_for, law.problem) == (RL_CBF_CLF_QP.name, RL_CLF_QP):
        return OnFlatGround(policy, gaits.step_length if isinstance(gaits, Gait) else gaits.start_length)
    raise PolicyFileError(f"policy: it was trained for {file.metadata.about}; this controller needs {law.problem}")
