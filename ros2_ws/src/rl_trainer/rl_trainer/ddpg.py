"""DDPG [SectionRL], literal and as it works: the parameters choose.

    critic: fit   Q(s, mu, a)  to  r + discount (1 - failed) Q'(s', mu', pi'(s'))
    actor:  ascend  Q(s, mu, pi(s))                                               deterministic policy gradient

Literal: a plain network with one output that does not see mu, stored actions, discount > 0. What works: discount 0, a
head for each quantity, mu known to the critic, the critic in the reward's form, and the reward recomputed for sampled
actions, which it can be because the measured error does not depend on the action. With discount 0 this is a contextual
bandit: no value is carried from one tick to another.
"""

import copy
from dataclasses import replace
from typing import Any

import torch
from torch import Tensor, nn

from rl_trainer.actor import Actor
from rl_trainer.critic import Action, AffineCritic, Seen, make_critic
from rl_trainer.learner import AveragedActor, ClippedAdam, follow, weights_of
from rl_trainer.parameters import TrainingParameters
from rl_trainer.replay import Batch
from rl_trainer.reward import norm

RELABEL_MU = 0.4  # of a typical mu: deviation of the mu that another action is asked for in the first approach


class Ddpg(AveragedActor):
    """Actor and critic with their averages; see `TrainingParameters` for its options."""

    def __init__(self, parameters: TrainingParameters) -> None:
        super().__init__(parameters)
        self._critic = make_critic(parameters)
        self._target_critic = copy.deepcopy(self._critic).requires_grad_(False)
        self._critic_optimizer = ClippedAdam(self._critic, parameters.critic_rate, parameters.gradient_clip)
        self._generator = torch.Generator().manual_seed(parameters.seed + 1)
        self._weights = torch.tensor(parameters.weights)

    def update(self, batch: Batch, rate: float) -> dict[str, float]:
        """One step of the critic, then one of the actor."""
        size = self.actor.clf_size(batch.LgV)
        action = self._act(self.actor, batch.observation, batch.LgV, size)
        seen = self._critic.see(batch)
        critic_loss = self._critic_loss(batch, seen, size, action)
        self._critic_optimizer.descend(critic_loss, rate)
        if isinstance(self._critic, AffineCritic):
            self._critic.steady_slopes(self._parameters.alpha_decay * self._parameters.critic_rate * rate)
        seen = tuple(each.detach() for each in seen)  # an affine critic has said it all before this step
        actor_loss = -self._critic(batch, seen, self._probe(batch), action).sum(1).mean()
        self.descend(actor_loss, rate)
        if self._parameters.discount > 0:
            follow(weights_of(self._target_critic), weights_of(self._critic), self._parameters.polyak)
        return {"critic": critic_loss.item(), "actor": actor_loss.item()}

    def state_dict(self) -> dict[str, Any]:
        """All that a checkpoint must hold."""
        return {
            "actor": super().state_dict(),
            "critic": self._critic.state_dict(),
            "target_critic": self._target_critic.state_dict(),
            "optimizer": self._critic_optimizer.state_dict(),
            "generator": self._generator.get_state(),
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        super().load_state_dict(state["actor"])
        self._critic.load_state_dict(state["critic"])
        self._target_critic.load_state_dict(state["target_critic"])
        self._critic_optimizer.load_state_dict(state["optimizer"])
        self._generator.set_state(state["generator"])

    def _critic_loss(self, batch: Batch, seen: Seen, size: Tensor, acted: Action) -> Tensor:
        p = self._parameters
        if p.relabel:
            mu, action, reward = self._relabelled(batch, size, acted)
        else:
            mu, action, reward = batch.mu, self._stored(batch, size), batch.reward
        wanted = reward + batch.penalty[:, None] / p.n
        if p.heads == "one":
            wanted = wanted.sum(1, keepdim=True)
        if p.discount > 0:
            wanted = wanted + p.discount * (1 - batch.failed[:, None]) * self._next_value(batch)
        loss = nn.functional.smooth_l1_loss if p.critic_loss == "huber" else nn.functional.mse_loss
        return loss(self._critic(batch, seen, mu, action), wanted)

    @torch.no_grad()
    def _next_value(self, batch: Batch) -> Tensor:
        size = self.actor.clf_size(batch.next_LgV)
        action = self._act(self.average, batch.next_observation, batch.next_LgV, size)
        following = replace(batch, observation=batch.next_observation, LgV=batch.next_LgV)
        q: Tensor = self._target_critic(following, self._target_critic.see(following), batch.next_mu, action)
        return q

    def _act(self, actor: Actor, observation: Tensor, LgV: Tensor, size: Tensor) -> Action:
        flat = actor.unit_action(observation, LgV, size)
        return Action(*actor.in_units(flat, size), flat)

    def _stored(self, batch: Batch, size: Tensor) -> Action:
        """The action that was taken."""
        alpha_scale, beta_scale = self.actor.units(size)
        flat = torch.cat([(batch.alpha / alpha_scale).flatten(1), batch.beta / beta_scale], 1)
        return Action(batch.alpha, batch.beta, flat)

    @torch.no_grad()
    def _relabelled(self, batch: Batch, size: Tensor, acted: Action) -> tuple[Tensor, Action, Tensor]:
        """Another action, the mu it is asked for, and the reward it would have had: -w norm(correction - target).

        In the first approach the same input v was measured; it is what another action makes of another mu.
        """
        p = self._parameters
        flat = acted.flat.detach()
        flat = flat + p.relabel_noise * self._noise(flat)
        mu, action = batch.mu, Action(*self.actor.in_units(flat, size), flat)
        if p.problem.corrects_input:
            v = batch.mu + self._stored(batch, size).correction(batch.mu)
            mu = batch.mu + RELABEL_MU * p.problem.mu_unit * self._noise(batch.mu)
            beta = v - mu - torch.einsum("bij,bj->bi", action.alpha, mu)
            action = Action(action.alpha, beta, torch.empty(0))
        error = action.correction(mu) / batch.unit - batch.target
        return mu, action, -self._weights * norm(error, p.error_norm)

    def _probe(self, batch: Batch) -> Tensor:
        """The mu at which the critic judges the actor: the executed, or, if t is affine, any about mu_qp."""
        if not self._parameters.is_affine:
            return batch.mu
        return batch.mu_qp + self._parameters.probe_noise * self._noise(batch.mu)

    def _noise(self, like: Tensor) -> Tensor:
        return torch.randn(like.shape, generator=self._generator)
