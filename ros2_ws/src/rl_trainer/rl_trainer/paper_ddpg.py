"""DDPG as the paper states it [SectionRL]: deterministic policy gradient with target networks.

    critic: fit   Q(s, a)  to  r + discount (1 - failed) Q'(s', pi'(s'))
    actor:  ascend  Q(s, pi(s))

s is the scaled observation, a the 25 values alpha and beta over their scales, r the reward of the tick, summed over
the quantities. What works instead is in `ddpg.py`; docs/differences_from_paper.md says why.
"""

import copy

import torch
from torch import Tensor, nn

from rl_trainer.actor import Actor, Scaling, hidden_layers
from rl_trainer.learner import ClippedAdam, Learner, follow
from rl_trainer.parameters import TrainingParameters
from rl_trainer.replay import Batch

DISCOUNT = 0.99


class PlainCritic(nn.Module):
    """A network from (s, a) to Q."""

    def __init__(self, parameters: TrainingParameters) -> None:
        super().__init__()
        self.scaling = Scaling(parameters)
        actions = (parameters.problem.inputs + 1) * parameters.n
        self.network = hidden_layers(len(parameters.observation) + actions, parameters, 1)

    def forward(self, observation: Tensor, action: Tensor) -> Tensor:
        """Raw observation (b, m) and action over its scales (b, (p + 1) n) to Q (b, 1)."""
        return self.network(torch.cat([self.scaling(observation), action], 1))


class PaperDdpg(Learner):
    """Actor and critic, each with its target network and optimiser; the actor itself walks."""

    def __init__(self, parameters: TrainingParameters) -> None:
        self._parameters = parameters
        self.acting, self._critic = Actor(parameters), PlainCritic(parameters)
        self._target_actor = copy.deepcopy(self.acting).requires_grad_(False)
        self._target_critic = copy.deepcopy(self._critic).requires_grad_(False)
        self._actor_optimizer = ClippedAdam(self.acting, parameters.actor_rate)
        self._critic_optimizer = ClippedAdam(self._critic, parameters.critic_rate)

    def update(self, batch: Batch, rate: float) -> dict[str, float]:
        """One step of the critic, then one of the actor."""
        p, size = self._parameters, self.acting.clf_size(batch.LgV)
        action = self.acting.unit_action(batch.observation, batch.LgV, size)
        reward = (batch.reward + batch.penalty[:, None] / p.n).sum(1, keepdim=True)
        wanted = reward + DISCOUNT * (1 - batch.failed[:, None]) * self.next_value(batch)
        alpha_unit, beta_unit = self.acting.units(size)
        taken = torch.cat([(batch.alpha / alpha_unit).flatten(1), batch.beta / beta_unit], 1)
        critic_loss = nn.functional.mse_loss(self._critic(batch.observation, taken), wanted)
        self._critic_optimizer.descend(critic_loss, rate)
        actor_loss = -self._critic(batch.observation, action).mean()
        self._actor_optimizer.descend(actor_loss, rate)
        follow(self._target_actor, self.acting, p.polyak)
        follow(self._target_critic, self._critic, p.polyak)
        return {"critic": critic_loss.item(), "actor": actor_loss.item()}

    @torch.no_grad()
    def next_value(self, batch: Batch) -> Tensor:
        """Q'(s', pi'(s')), (b, 1)."""
        actor = self._target_actor
        action = actor.unit_action(batch.next_observation, batch.next_LgV, actor.clf_size(batch.next_LgV))
        return self._target_critic(batch.next_observation, action)
