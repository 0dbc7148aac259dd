"""Proximal policy optimisation (Schulman et al., arXiv 1707.06347) of a small network on batches of robots.

The mean of the action is the network's output through tanh, so that the network alone, without noise, is the policy
that is shipped. The value network also reads what no robot knows, its plant (Pinto et al., arXiv 1710.06542).
Advantages are generalised ones (arXiv 1506.02438). A walk that ended well goes on, for the value, as
if nothing had ended.
"""

import math
from typing import Any, ClassVar

import numpy as np
import torch
from pydantic import BaseModel, ConfigDict, Field
from rabbit_description.state import Array
from torch import Tensor, nn

from rabbit_residual.fleet import Rollout


class PpoParameters(BaseModel):
    """What may be chosen; the defaults are those of the shipped policy."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    hidden: int = Field(96, ge=1, le=4096, description="units of each of the two hidden layers")
    learning_rate: float = Field(4e-4, gt=0, le=1, description="of Adam")
    gamma: float = Field(0.99, ge=0, lt=1, description="discount a tick")
    lam: float = Field(0.95, ge=0, le=1, description="lambda of the advantages")
    clip: float = Field(0.2, gt=0, lt=1, description="of the ratio of probabilities")
    epochs: int = Field(5, ge=1, le=100, description="over each rollout")
    minibatch: int = Field(2048, ge=1, description="ticks")
    most_kl: float = Field(0.03, gt=0, description="divergence from the rollout's policy that ends the epochs")
    first_std: float = Field(0.25, gt=0, le=1, description="of the exploration's noise")
    stds: tuple[float, float] = Field((0.05, 0.5), description="between which it stays")


class Ppo:
    """Policy and value networks. `act` explores, `update` learns, `state` and `restore` are for checkpoints."""

    figures: ClassVar = ("std", "divergence")

    def __init__(self, reads: int, known: int, says: int, parameters: PpoParameters, seed: int) -> None:
        torch.manual_seed(seed)
        p = self._parameters = parameters
        self.actor = network(reads, says, p.hidden, nn.ReLU)
        self._critic = network(reads + known, 1, p.hidden, nn.Tanh)
        with torch.no_grad():
            for value in self.actor[-1].parameters():
                value.mul_(0.05)  # it begins by saying next to nothing
        self._log_std = nn.Parameter(torch.full((says,), math.log(p.first_std)))
        self._all = [*self.actor.parameters(), self._log_std, *self._critic.parameters()]
        self._adam = torch.optim.Adam(self._all, lr=p.learning_rate)
        self._rng = np.random.default_rng(seed)

    def act(self, reads: Array) -> Array:
        """Actions (N, m) with noise, not cut to [-1, 1], at `reads` (N, r)."""
        with torch.no_grad():
            mean = torch.tanh(self.actor(torch.as_tensor(reads, dtype=torch.float32))).numpy()
            std = self._log_std.exp().numpy()
        actions: Array = mean + std * self._rng.standard_normal(mean.shape)
        return actions

    def update(self, rollouts: list[Rollout]) -> tuple[float, ...]:
        """Learn from them; returns the noise's mean standard deviation, and how far the policy is from the old one."""
        p, pieces = self._parameters, [self._piece(each) for each in rollouts]
        reads, known, said, advantage, value = (torch.cat(part) for part in zip(*pieces, strict=True))
        advantage = (advantage - advantage.mean()) / (advantage.std() + 1e-8)
        with torch.no_grad():
            old = self._log_probability(reads, said)
        divergence = 0.0
        for _ in range(p.epochs):
            for rows in torch.randperm(len(reads)).split(p.minibatch):
                ratio = (self._log_probability(reads[rows], said[rows]) - old[rows]).exp()
                gain = torch.min(ratio * advantage[rows], ratio.clamp(1 - p.clip, 1 + p.clip) * advantage[rows])
                miss = (self._critic(known[rows]).squeeze(-1) - value[rows]) ** 2
                self._adam.zero_grad()
                (0.5 * miss.mean() - gain.mean()).backward()
                nn.utils.clip_grad_norm_(self._all, 0.5)
                self._adam.step()
            with torch.no_grad():
                divergence = float((old - self._log_probability(reads, said)).mean())
                self._log_std.clamp_(*map(math.log, p.stds))
            if divergence > p.most_kl:
                break
        return float(self._log_std.detach().exp().mean()), divergence

    def arrays(self) -> dict[str, Array]:
        """The actor's, see `actor_arrays`."""
        return actor_arrays(self.actor)

    def state(self) -> dict[str, Any]:
        """All that an update goes on from."""
        return {
            "actor": self.actor.state_dict(),
            "critic": self._critic.state_dict(),
            "log_std": self._log_std.detach().clone(),
            "adam": self._adam.state_dict(),
        }

    def restore(self, state: dict[str, Any], seed: int) -> None:
        """Go on from there, with new noise; raises KeyError or RuntimeError for a state of another network."""
        self.actor.load_state_dict(state["actor"])
        self._critic.load_state_dict(state["critic"])
        with torch.no_grad():
            self._log_std.copy_(state["log_std"])
        self._adam.load_state_dict(state["adam"])
        torch.manual_seed(seed)
        self._rng = np.random.default_rng(seed)

    def _log_probability(self, reads: Tensor, said: Tensor) -> Tensor:
        """Of actions, but for a constant."""
        error = (said - torch.tanh(self.actor(reads))) / self._log_std.exp()
        return (-0.5 * error**2 - self._log_std).sum(-1)

    def _piece(self, rollout: Rollout) -> tuple[Tensor, ...]:
        """What both networks read, actions, advantages and values of its T ticks and N robots, in a row."""
        reads = torch.as_tensor(rollout.reads, dtype=torch.float32)
        known = torch.cat([reads, torch.as_tensor(rollout.known, dtype=torch.float32)], dim=2)
        with torch.no_grad():
            value = self._critic(known).squeeze(-1).numpy()
        advantage = advantages(value, rollout, self._parameters.gamma, self._parameters.lam)
        said = torch.as_tensor(rollout.said, dtype=torch.float32)
        found = torch.as_tensor(advantage, dtype=torch.float32)
        whole = found + torch.as_tensor(value[:-1])
        return (
            reads[:-1].flatten(0, 1),
            known[:-1].flatten(0, 1),
            said[:-1].flatten(0, 1),
            found.flatten(),
            whole.flatten(),
        )


def advantages(value: Array, rollout: Rollout, gamma: float, lam: float) -> Array:
    """Of each but the last tick, (T, N): the sum over k of (gamma lam)^k delta, within the episode."""
    ticks = len(value) - 1
    found, ahead = np.zeros((ticks, value.shape[1])), np.zeros(value.shape[1])
    for tick in reversed(range(ticks)):
        ended, failed = rollout.ended[tick], rollout.failed[tick]
        following = np.where(ended, np.where(failed, 0.0, value[tick]), value[tick + 1])
        delta = rollout.reward[tick] + gamma * following - value[tick]
        ahead = found[tick] = delta + gamma * lam * np.where(ended, 0.0, ahead)
    return found


def network(reads: int, says: int, hidden: int, activation: type[nn.Module]) -> nn.Sequential:
    """Two hidden layers."""
    first, second = nn.Linear(reads, hidden), nn.Linear(hidden, hidden)
    return nn.Sequential(first, activation(), second, activation(), nn.Linear(hidden, says))


def actor_arrays(actor: nn.Sequential) -> dict[str, Array]:
    """`0.weight` to `2.bias`."""
    layers = [layer for layer in actor if isinstance(layer, nn.Linear)]
    return {
        f"{i}.{name}": value.detach().numpy().copy()
        for i, layer in enumerate(layers)
        for name, value in layer.named_parameters()
    }
