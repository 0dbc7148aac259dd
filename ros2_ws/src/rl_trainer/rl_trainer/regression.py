"""Supervised learning on the same transitions, the paper's open question: the actor fits the measured error itself.

    minimise  sum_i ((alpha_i mu + beta_i - target_i) / S_i)^2

In the first approach the executed v and the measured y'' say what the input should have been had y'' been asked for:
v = y'' + alpha y'' + beta, an inverse model without a critic.
"""

import torch

from rl_trainer.learner import AveragedActor
from rl_trainer.replay import Batch


class Regression(AveragedActor):
    """The actor alone, with the same average and optimiser as in DDPG."""

    def update(self, batch: Batch, rate: float) -> dict[str, float]:
        """One step down the estimation errors."""
        mu, target = batch.mu, batch.target * batch.unit
        if self._parameters.problem.corrects_input:
            mu = mu + torch.einsum("bij,bj->bi", batch.alpha, mu) + batch.beta - target
        alpha, beta = self.actor(batch.observation, batch.LgV)
        error = (torch.einsum("bij,bj->bi", alpha, mu) + beta - target) / batch.unit
        loss = (error * error).sum(1).mean()
        self.descend(loss, rate)
        return {"actor": loss.item()}
