"""The trainer's messages from its dataclasses."""

from array import array

from builtin_interfaces.msg import Time
from rabbit_msgs import msg
from rl_cbf_clf_controller.weights import PolicyFile

from rl_trainer.parameters import TrainingParameters
from rl_trainer.reward import reward_terms
from rl_trainer.training import EpisodePlan
from rl_trainer.transitions import Transition

SEQUENCES = ("observation", "alpha", "beta", "nominal", "measured", "next_observation")
ZERO = "zero"


def transition_message(
    transition: Transition, parameters: TrainingParameters, episode: int, at: Time
) -> msg.Transition:
    """A transition with its reward, term by term."""
    terms = reward_terms(transition, parameters)
    message = msg.Transition(
        stamp=at,
        episode=episode,
        tick=transition.tick,
        step_index=transition.step_index,
        problem=str(transition.problem),
        lgv=transition.LgV,
        mu=transition.mu,
        next_lgv=transition.next_LgV,
        mu_qp=transition.mu_qp,
        next_mu=transition.next_mu,
        reward_terms=array("d", terms.estimation.tobytes()),
        reward=terms.total,
        failed=transition.failed,
        doubt=int(transition.doubt),
    )
    for name in SEQUENCES:
        setattr(message, name, array("d", getattr(transition, name).tobytes()))
    return message


def weights_message(policy: PolicyFile, source: str, at: Time) -> msg.PolicyWeights:
    """A policy as the bytes of its file."""
    return msg.PolicyWeights(stamp=at, version=policy.version, source=source, data=array("B", policy.encode()))


def plan_message(plan: EpisodePlan, after: int, at: Time) -> msg.EpisodePlan:
    """How the episode after number `after` is to be walked."""
    version = plan.policy.version if plan.policy else ZERO
    return msg.EpisodePlan(stamp=at, after_episode=after, seed=plan.seed, sigma=plan.sigma, policy_version=version)
