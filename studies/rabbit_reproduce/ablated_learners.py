"""Learners with one choice of `rl_trainer.ddpg.Ddpg` undone, for the ablations."""

import copy

import numpy as np
import torch
from rl_cbf_clf_controller.weights import PROBE, Arrays, probe_inputs
from rl_trainer.actor import FIRST_OUTPUTS, Actor, Scaling, hidden_layers
from rl_trainer.ddpg import SAMPLED_ACTION, AffineCritic, Ddpg, RewardCritic, correction
from rl_trainer.learner import AveragedActor, ClippedAdam, follow
from rl_trainer.parameters import TrainingParameters
from rl_trainer.replay import Batch
from torch import Tensor, nn


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


class SeparateActor(Actor):
    """A network for each quantity (Remark 1); the policy file holds them as blocks of one wide network."""

    def make_network(self, parameters: TrainingParameters, outputs: int) -> nn.ModuleList:
        """V's has the matrix where its row is structured."""
        rows = self.m + 1
        sizes = [self.m * rows if self.structured and i == 0 else rows for i in range(self.n)]
        self.hidden = (parameters.hidden1 * self.n, parameters.hidden2 * self.n)
        starts, plain = np.cumsum([0, *sizes]), range(1 if self.structured else 0, self.n)
        matrix = range(sizes[0]) if self.structured else ()
        alphas = [starts[i] + j for i in plain for j in range(self.m)]
        self._order = torch.tensor([*matrix, *alphas, *(starts[i] + self.m for i in plain)])
        inputs = len(parameters.observation)
        return nn.ModuleList(hidden_layers(inputs, parameters, size, FIRST_OUTPUTS) for size in sizes)

    def outputs(self, scaled: Tensor) -> Tensor:
        """The tanh outputs in the order of the policy file, (b, outputs)."""
        return torch.tanh(torch.cat([network(scaled) for network in self.network], 1)[:, self._order])

    @torch.no_grad()
    def steady_alphas(self, share: float) -> None:
        """As with one network."""
        shares = 1 - share * self._alphas[torch.argsort(self._order)]
        layers = [network[-1] for network in self.network]
        for layer, part in zip(layers, shares.split([layer.out_features for layer in layers]), strict=True):
            layer.weight.mul_(part)

    @torch.no_grad()
    def arrays(self) -> Arrays:
        """The weights as one network, with the probe's outputs."""
        layers = list(zip(*(network[::2] for network in self.network), strict=True))
        weights = [torch.cat([layer.weight for layer in layers[0]])]
        weights += [torch.block_diag(*(layer.weight for layer in layers[i])) for i in (1, 2)]
        biases = [torch.cat([layer.bias for layer in each]) for each in layers]
        weights[2], biases[2] = weights[2][self._order], biases[2][self._order]
        values = {PROBE: self.outputs(torch.from_numpy(probe_inputs(len(self.scaling.center))))}
        values |= {f"{i}.weight": weights[i] for i in range(3)} | {f"{i}.bias": biases[i] for i in range(3)}
        return {name: value.numpy().copy() for name, value in values.items()}


class SeparateNetworks(Ddpg):
    """A network for each quantity."""

    actor_type = SeparateActor


class HeadedCritic(nn.Module):
    """A network from (s, mu, a) to Q, with so many heads."""

    def __init__(self, parameters: TrainingParameters, heads: int) -> None:
        super().__init__()
        self.scaling, self.mu_unit = Scaling(parameters), parameters.problem.mu_unit
        m = parameters.problem.inputs
        self.network = hidden_layers(len(parameters.observation) + m + (m + 1) * parameters.n, parameters, heads)

    def forward(self, observation: Tensor, mu: Tensor, action: Tensor) -> Tensor:
        """Q, shape (b, heads)."""
        q: Tensor = self.network(torch.cat([self.scaling(observation), mu / self.mu_unit, action], 1))
        return q


class PlainCritic(AveragedActor):
    """The critic is a network with a head for each quantity; the rest is `Ddpg`'s, but for what subclasses say."""

    discount, relabels, has_one_head = 0.0, True, False

    def __init__(self, parameters: TrainingParameters) -> None:
        super().__init__(parameters)
        self._critic = HeadedCritic(parameters, 1 if self.has_one_head else parameters.n)
        self._target_critic = copy.deepcopy(self._critic).requires_grad_(False)
        self._critic_optimizer = ClippedAdam(self._critic, parameters.critic_rate)
        self._generator = torch.Generator().manual_seed(parameters.seed + 1)

    def update(self, batch: Batch, rate: float) -> dict[str, float]:
        """One step of the critic, then one of the actor."""
        p, size = self._parameters, self.actor.clf_size(batch.LgV)
        action = self.actor.unit_action(batch.observation, batch.LgV, size)
        with torch.no_grad():
            taken, reward = self._relabelled(batch, size, action) if self.relabels else self._stored(batch, size)
            wanted = reward + batch.penalty[:, None] / p.n
            if self.has_one_head:
                wanted = wanted.sum(1, keepdim=True)
            if self.discount:
                wanted = wanted + self.discount * (1 - batch.failed[:, None]) * self._next_value(batch)
        critic_loss = nn.functional.smooth_l1_loss(self._critic(batch.observation, batch.mu, taken), wanted)
        self._critic_optimizer.descend(critic_loss, rate)
        actor_loss = -self._critic(batch.observation, batch.mu, action).sum(1).mean()
        self.descend(actor_loss, rate)
        if self.discount:
            follow(self._target_critic, self._critic, p.polyak)
        return {"critic": critic_loss.item(), "actor": actor_loss.item()}

    def _relabelled(self, batch: Batch, size: Tensor, action: Tensor) -> tuple[Tensor, Tensor]:
        flat = action + SAMPLED_ACTION * torch.randn(action.shape, generator=self._generator)
        error = correction(*self.actor.in_units(flat, size), batch.mu) / batch.unit - batch.target
        return flat, -(error * error)

    def _stored(self, batch: Batch, size: Tensor) -> tuple[Tensor, Tensor]:
        alpha_unit, beta_unit = self.actor.units(size)
        return torch.cat([(batch.alpha / alpha_unit).flatten(1), batch.beta / beta_unit], 1), batch.reward

    def _next_value(self, batch: Batch) -> Tensor:
        size = self.actor.clf_size(batch.next_LgV)
        action = self.acting.unit_action(batch.next_observation, batch.next_LgV, size)
        q: Tensor = self._target_critic(batch.next_observation, batch.next_mu, action)
        return q


class NoRelabel(PlainCritic):
    """It learns from the actions taken only."""

    relabels = False


class Gamma09(NoRelabel):
    """Discount 0.9."""

    discount = 0.9


class Gamma099(NoRelabel):
    """Discount 0.99."""

    discount = 0.99


class OneHead(NoRelabel):
    """One Q for the sum of all terms."""

    has_one_head = True
