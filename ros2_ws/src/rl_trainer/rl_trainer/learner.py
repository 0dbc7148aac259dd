"""What a learner is: it owns an actor and improves it from minibatches. DDPG and regression are two of them."""

import copy
from typing import Any, Protocol

import torch
from torch import Tensor, nn

from rl_trainer.actor import Actor
from rl_trainer.parameters import TrainingParameters
from rl_trainer.replay import Batch

WARM_UP = 0.1  # an average over the last tenth of few updates, so that it forgets the untrained actor


class Learner(Protocol):
    """Bring your own: `rl_trainer.training.Trainer` takes any object with these."""

    @property
    def acting(self) -> Actor:
        """The actor to walk with."""

    def update(self, batch: Batch, rate: float) -> dict[str, float]:
        """One update; `rate` multiplies the learning rates. Returns named losses."""

    def state_dict(self) -> dict[str, Any]:
        """All that a checkpoint must hold."""

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint."""


class AveragedActor:
    """An actor, its optimiser, and the running average of its weights (the target actor of DDPG)."""

    def __init__(self, parameters: TrainingParameters) -> None:
        self._parameters = parameters
        self.actor = Actor(parameters)
        self.average = copy.deepcopy(self.actor).requires_grad_(False)
        self._optimizer = ClippedAdam(self.actor, parameters.actor_rate, parameters.gradient_clip)
        self._updates = 0

    @property
    def acting(self) -> Actor:
        """The actor to walk with: the average, or the actor itself."""
        return self.average if self._parameters.act_with_average else self.actor

    def descend(self, loss: Tensor, rate: float) -> None:
        """One step down the loss, then move the average."""
        self._optimizer.descend(loss, rate)
        self.actor.steady_alphas(self._parameters.alpha_decay * self._parameters.actor_rate * rate)
        self._updates += 1
        share = self._parameters.polyak
        if self._parameters.act_with_average:
            share = max(share, 1 / (1 + WARM_UP * self._updates))
        follow(self.average, self.actor, share)

    def state_dict(self) -> dict[str, Any]:
        """Weights, average, optimiser and the number of updates."""
        return {
            "actor": self.actor.state_dict(),
            "average": self.average.state_dict(),
            "optimizer": self._optimizer.state_dict(),
            "updates": self._updates,
        }

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """The inverse of `state_dict`."""
        self.actor.load_state_dict(state["actor"])
        self.average.load_state_dict(state["average"])
        self._optimizer.load_state_dict(state["optimizer"])
        self._updates = state["updates"]


class ClippedAdam(torch.optim.Adam):
    """Adam with a clipped gradient and a rate that can be scaled at each step."""

    def __init__(self, network: nn.Module, rate: float, clip: float) -> None:
        super().__init__(network.parameters(), lr=rate, fused=True)
        self._rate, self._clip = rate, clip

    def descend(self, loss: Tensor, rate: float) -> None:
        """One step down `loss` with the learning rate times `rate`."""
        (group,) = self.param_groups
        group["lr"] = self._rate * rate
        self.zero_grad()
        loss.backward()
        nn.utils.clip_grad_norm_(group["params"], self._clip)
        self.step()


@torch.no_grad()
def follow(average: nn.Module, network: nn.Module, share: float) -> None:
    """Move every weight of `average` by `share` of its distance to `network`."""
    torch._foreach_lerp_(list(average.parameters()), list(network.parameters()), share)
