"""Learners with one choice of `rl_trainer.ddpg.Ddpg` undone, for the ablations."""

from rl_trainer.ddpg import AffineCritic, Ddpg, RewardCritic
from rl_trainer.parameters import TrainingParameters
from torch import Tensor


class VaryingAlpha(Ddpg):
    """Alpha is free to vary with the state."""

    alpha_decay = 0.0


class NotAffine(Ddpg):
    """The critic does not know that errors are affine in mu."""

    def make_critic(self, parameters: TrainingParameters) -> RewardCritic:
        """A network of (s, mu)."""
        return RewardCritic(parameters)


class AbsoluteCritic(AffineCritic):
    """Of absolute errors."""

    def reward(self, error: Tensor) -> Tensor:
        """Of a scaled error, each (b, n)."""
        return -error.abs()


class AbsoluteError(Ddpg):
    """The reward counts absolute errors."""

    def make_critic(self, parameters: TrainingParameters) -> RewardCritic:
        """Of absolute errors."""
        return AbsoluteCritic(parameters)
