"""What a learner is: it owns an actor and improves it from minibatches. DDPG and regression are two of them."""

import copy
from typing import Any, Protocol

import torch
from torch import Tensor, nn
from torch.optim.adam import adam

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
        self._follows = weights_of(self.average), weights_of(self.actor)
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
        follow(*self._follows, share)

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


class ClippedAdam:
    """Adam with a clipped gradient and a rate that can be scaled at each step.

    It does what `torch.optim.Adam(fused=True)` does in a third of the time: nothing is looked up or hooked on.
    """

    def __init__(self, network: nn.Module, rate: float, clip: float) -> None:
        self._weights = weights_of(network)
        self._rate, self._clip = rate, clip
        self._state = {
            "mean": [torch.zeros_like(weight) for weight in self._weights],
            "square": [torch.zeros_like(weight) for weight in self._weights],
            "steps": [torch.zeros(()) for _ in self._weights],
        }

    def descend(self, loss: Tensor, rate: float) -> None:
        """One step down `loss` with the learning rate times `rate`."""
        gradients = torch.autograd.grad(loss, self._weights)
        with torch.no_grad():
            norm = torch.linalg.vector_norm(torch.stack(torch._foreach_norm(gradients)))
            torch._foreach_mul_(gradients, torch.clamp(self._clip / (norm + 1e-6), max=1.0))
            adam(
                self._weights,
                list(gradients),
                self._state["mean"],
                self._state["square"],
                [],
                self._state["steps"],
                fused=True,
                amsgrad=False,
                beta1=0.9,
                beta2=0.999,
                lr=self._rate * rate,
                weight_decay=0.0,
                eps=1e-8,
                maximize=False,
            )

    def state_dict(self) -> dict[str, list[Tensor]]:
        """Running means of gradients and of their squares, and how many there were."""
        return {name: [each.clone() for each in values] for name, values in self._state.items()}

    def load_state_dict(self, state: dict[str, list[Tensor]]) -> None:
        """The inverse of `state_dict`."""
        for name, values in self._state.items():
            for mine, given in zip(values, state[name], strict=True):
                mine.copy_(given)


def weights_of(network: nn.Module) -> list[Tensor]:
    """All that is learned, in order."""
    return list(network.parameters())


@torch.no_grad()
def follow(average: list[Tensor], weights: list[Tensor], share: float) -> None:
    """Move every weight of an average by `share` of its distance to the weight it follows."""
    torch._foreach_lerp_(average, weights, share)
