"""Soft actor-critic (Haarnoja et al., arXiv 1812.05905) with twin critics and a temperature that it finds itself.

One minibatch each `every` ticks. The actor's mean, through tanh, is the policy that is shipped. The critics also read
what no robot knows, its plant. A walk that ended well goes on, for the value, as if nothing had ended.
"""

import math
from copy import deepcopy
from typing import Any, ClassVar

import numpy as np
import torch
from pydantic import BaseModel, ConfigDict, Field
from rabbit_description.state import Array
from torch import Tensor, nn

from rabbit_residual.fleet import Rollout
from rabbit_residual.ppo import actor_arrays, network

LEAST_LOG_STD, MOST_LOG_STD = -5.0, 2.0
TINY = 1e-6  # of a probability


class SacParameters(BaseModel):
    """What may be chosen; the defaults are those of the shipped policy."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    hidden: int = Field(256, ge=1, le=4096, description="units of each of the two hidden layers")
    learning_rate: float = Field(3e-4, gt=0, le=1, description="of Adam, for actor and temperature")
    critic_rate: float = Field(1e-3, gt=0, le=1, description="of Adam, for the critics")
    gamma: float = Field(0.99, ge=0, lt=1, description="discount a tick")
    tau: float = Field(0.005, gt=0, le=1, description="by which the target critics follow in an update")
    batch: int = Field(256, ge=1, description="ticks of an update")
    every: int = Field(32, ge=1, description="ticks between two updates")
    buffer: int = Field(500_000, ge=1, description="ticks")
    first: int = Field(20_000, ge=0, description="ticks before the first update")
    temperature: float = Field(0.01, gt=0, description="at first")


class Replay:
    """The last rollouts, of the same ticks and robots, in float32; at most so many `ticks` and at least one rollout."""

    def __init__(self, ticks: int) -> None:
        self._most, self._kept, self._added = ticks, dict[str, Array](), 0

    def add(self, rollouts: list[Rollout]) -> int:
        """Keep the rollouts of several fleets as one; returns how many transitions there are in all."""
        for name in vars(rollouts[0]):
            values = np.concatenate([getattr(each, name) for each in rollouts], axis=1)
            kind = np.float32 if values.dtype == float else values.dtype
            kept = self._room(name, values.shape, kind)
            kept[self._added % len(kept)] = values
        self._added += 1
        return (len(values) - 1) * values.shape[1] * min(self._added, len(kept))

    def state(self) -> dict[str, Any]:
        """All of it."""
        kept = {name: torch.as_tensor(values[: self._added]) for name, values in self._kept.items()}
        return {"kept": kept, "added": self._added}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from there."""
        self._added = state["added"]
        for name, values in state["kept"].items():
            found = values.numpy()
            self._room(name, found.shape[1:], found.dtype)[: len(found)] = found

    def _room(self, name: str, shape: tuple[int, ...], kind: Any) -> Array:
        """Where rollouts of such a `shape`, (T + 1, N, ...), are kept."""
        if name not in self._kept:
            most = max(self._most // ((shape[0] - 1) * shape[1]), 1)
            self._kept[name] = np.empty((most, *shape), kind)
        return self._kept[name]

    def sample(self, batch: int, rng: "np.random.Generator") -> dict[str, Tensor]:
        """Transitions: what `Rollout` has of their ticks, and `after`, `after_known`: what was read and known then."""
        among, ticks, robots = self._kept["ended"].shape
        sizes = min(self._added, among), ticks - 1, robots  # the last tick only follows the one before
        rollout, tick, robot = (rng.integers(size, size=batch) for size in sizes)
        found = {name: values[rollout, tick, robot] for name, values in self._kept.items()}
        following = np.where(found["ended"], tick, tick + 1)
        found |= {f"after_{name}": self._kept[name][rollout, following, robot] for name in ("reads", "known")}
        return {name: torch.as_tensor(values) for name, values in found.items()}


class Sac:
    """Actor and critics. `act` explores, `update` learns, `state` and `restore` are for checkpoints."""

    figures: ClassVar = ("std", "temperature")

    def __init__(self, reads: int, known: int, says: int, parameters: SacParameters, seed: int) -> None:
        torch.manual_seed(seed)
        p = self._parameters = parameters
        self._actor = network(reads, 2 * says, p.hidden, nn.ReLU)
        with torch.no_grad():
            for value in self._actor[-1].parameters():
                value.mul_(0.05)  # it begins by saying next to nothing
        self._critics = nn.ModuleList(network(reads + known + says, 1, p.hidden, nn.ReLU) for _ in range(2))
        self._targets = deepcopy(self._critics).requires_grad_(False)
        self._log_temperature = nn.Parameter(torch.tensor(math.log(p.temperature)))
        groups = self._actor.parameters(), self._critics.parameters(), [self._log_temperature]
        rates = p.learning_rate, p.critic_rate, p.learning_rate
        self._adams = [torch.optim.Adam(group, lr=rate) for group, rate in zip(groups, rates, strict=True)]
        self._replay, self._rng, self._due = Replay(p.buffer), np.random.default_rng(seed), 0

    def act(self, reads: Array) -> Array:
        """Actions (N, m) in [-1, 1] with noise at `reads` (N, r)."""
        with torch.no_grad():
            action, _, self._std = self._sampled(torch.as_tensor(reads, dtype=torch.float32))
        return action.numpy().astype(float)

    def update(self, rollouts: list[Rollout]) -> tuple[float, ...]:
        """Learn from them and from former ones; returns the `figures`."""
        p, new = self._parameters, sum(each.reward[:-1].size for each in rollouts)
        if self._replay.add(rollouts) >= p.first:
            self._due += new
        for _ in range(self._due // p.every):
            self._learn(self._replay.sample(p.batch, self._rng))
        self._due %= p.every
        return float(self._std.mean()), float(self._log_temperature.detach().exp())

    def arrays(self) -> dict[str, Array]:
        """The actor's, `0.weight` to `2.bias`, of the mean alone."""
        found = actor_arrays(self._actor)
        return found | {name: np.split(found[name], 2)[0].copy() for name in ("2.weight", "2.bias")}

    def state(self) -> dict[str, Any]:
        """All that an update goes on from."""
        return {
            "networks": [each.state_dict() for each in (self._actor, self._critics, self._targets)],
            "log_temperature": self._log_temperature.detach().clone(),
            "adams": [adam.state_dict() for adam in self._adams],
            "replay": self._replay.state(),
        }

    def restore(self, state: dict[str, Any], seed: int) -> None:
        """Go on from there, with new noise; raises KeyError or RuntimeError for a state of other networks."""
        for own, each in zip((self._actor, self._critics, self._targets), state["networks"], strict=True):
            own.load_state_dict(each)
        with torch.no_grad():
            self._log_temperature.copy_(state["log_temperature"])
        for adam, each in zip(self._adams, state["adams"], strict=True):
            adam.load_state_dict(each)
        self._replay.restore(state["replay"])
        torch.manual_seed(seed)
        self._rng = np.random.default_rng(seed)

    def _learn(self, of: dict[str, Tensor]) -> None:
        """One minibatch."""
        p, temperature = self._parameters, self._log_temperature.exp().detach()
        actor_adam, critic_adam, temperature_adam = self._adams
        with torch.no_grad():
            action, log_p, _ = self._sampled(of["after_reads"])
            after = (
                self._value(self._targets, of["after_reads"], of["after_known"], action).amin(1) - temperature * log_p
            )
            goal = of["reward"] + p.gamma * ~of["failed"] * after
        miss = self._value(self._critics, of["reads"], of["known"], of["said"]) - goal[:, None]
        critic_adam.zero_grad()
        (miss**2).mean(0).sum().backward()
        critic_adam.step()

        action, log_p, _ = self._sampled(of["reads"])
        value = self._value(self._critics, of["reads"], of["known"], action).amin(1)
        actor_adam.zero_grad()
        (temperature * log_p - value).mean().backward()
        actor_adam.step()

        wanted = -action.shape[1]  # entropy
        temperature_adam.zero_grad()
        (-self._log_temperature * (log_p.detach() + wanted).mean()).backward()
        temperature_adam.step()

        with torch.no_grad():
            for target, critic in zip(self._targets.parameters(), self._critics.parameters(), strict=True):
                target.lerp_(critic, p.tau)

    def _sampled(self, reads: Tensor) -> tuple[Tensor, Tensor, Tensor]:
        """Actions (N, m), the logarithms of their probabilities (N,), and the noise before tanh (N, m)."""
        mean, wide = self._actor(reads).chunk(2, dim=1)
        log_std = LEAST_LOG_STD + 0.5 * (MOST_LOG_STD - LEAST_LOG_STD) * (torch.tanh(wide) + 1)
        noise = torch.randn_like(mean)
        action = torch.tanh(mean + log_std.exp() * noise)
        density = -0.5 * (noise**2 + math.log(2 * math.pi)) - log_std
        return action, (density - torch.log(1 - action**2 + TINY)).sum(1), log_std.exp()

    def _value(self, critics: nn.ModuleList, reads: Tensor, known: Tensor, action: Tensor) -> Tensor:
        """Of both, (N, 2)."""
        given = torch.cat([reads, known, action], dim=1)
        return torch.cat([critic(given) for critic in critics], dim=1)
