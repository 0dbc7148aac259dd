"""DAgger (Ross, Gordon, Bagnell, arXiv 1011.0686): a student learns what its teacher would do where the student walks.

Each tick of a rollout is an example: what was read, and as `said` the action that gives the teacher's torque. Torque is
in proportion to an action, so the squared error of one is that of the other. The teacher walks a share of the episodes,
all at first, then fewer and fewer.
"""

from typing import Any, ClassVar

import numpy as np
import torch
from pydantic import BaseModel, ConfigDict, Field
from rabbit_description.state import Array
from rabbit_residual.fleet import Rollout
from rabbit_residual.ppo import actor_arrays, network
from rabbit_residual.sac import Replay
from torch import nn


class DaggerParameters(BaseModel):
    """What may be chosen; the defaults are those of the shipped policy."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    hidden: int = Field(256, ge=1, le=4096, description="units of each of the two hidden layers")
    learning_rate: float = Field(5e-4, gt=0, le=1, description="of Adam")
    batch: int = Field(512, ge=1, description="ticks of an update")
    every: int = Field(128, ge=1, description="ticks between two updates")
    buffer: int = Field(1_000_000, ge=1, description="ticks")
    half: int = Field(200_000, ge=1, description="ticks in which the teacher's share of the episodes halves")


class Dagger:
    """The student. `act` says what it would do, `update` learns, `state` and `restore` are for checkpoints."""

    figures: ClassVar = ("taught", "error")

    def __init__(self, reads: int, says: int, parameters: DaggerParameters, seed: int) -> None:
        torch.manual_seed(seed)
        self._parameters = parameters
        self._actor = network(reads, says, parameters.hidden, nn.ReLU)
        self._adam = torch.optim.Adam(self._actor.parameters(), lr=parameters.learning_rate)
        self._replay, self._rng, self._ticks = Replay(parameters.buffer), np.random.default_rng(seed), 0

    @property
    def taught(self) -> float:
        """The share of the episodes that the teacher walks."""
        return float(0.5 ** (self._ticks / self._parameters.half))

    def act(self, reads: Array) -> Array:
        """Actions (N, m) in [-1, 1] at `reads` (N, r)."""
        with torch.no_grad():
            return torch.tanh(self._actor(torch.as_tensor(reads, dtype=torch.float32))).numpy().astype(float)

    def update(self, rollouts: list[Rollout]) -> tuple[float, ...]:
        """Learn from them and from former ones; returns the `figures`, the error as the root of its mean square."""
        p, taught = self._parameters, self.taught
        self._replay.add(rollouts)
        before = self._ticks
        self._ticks += sum(each.reward[:-1].size for each in rollouts)
        squares = [self._learn() for _ in range(self._ticks // p.every - before // p.every)]
        return taught, float(np.sqrt(np.mean(squares))) if squares else np.nan

    def arrays(self) -> dict[str, Array]:
        """See `actor_arrays`."""
        return actor_arrays(self._actor)

    def state(self) -> dict[str, Any]:
        """All that an update goes on from."""
        of_torch = {"actor": self._actor.state_dict(), "adam": self._adam.state_dict()}
        return {**of_torch, "replay": self._replay.state(), "ticks": self._ticks}

    def restore(self, state: dict[str, Any], seed: int) -> None:
        """Go on from there, with other draws; raises KeyError or RuntimeError for a state of another network."""
        self._actor.load_state_dict(state["actor"])
        self._adam.load_state_dict(state["adam"])
        self._replay.restore(state["replay"])
        self._ticks, self._rng = state["ticks"], np.random.default_rng(seed)

    def _learn(self) -> float:
        """One minibatch; returns the mean square of the error, 0 where the teacher had no answer."""
        of = self._replay.sample(self._parameters.batch, self._rng)
        loss = (torch.tanh(self._actor(of["reads"])) - of["said"]).nan_to_num().square().mean()
        self._adam.zero_grad()
        loss.backward()
        self._adam.step()
        return float(loss.detach())
