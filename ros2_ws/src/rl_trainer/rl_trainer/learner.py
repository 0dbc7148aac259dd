"""What a learner is: it owns an actor and improves it from minibatches. DDPG and regression are two of them."""

import copy
from abc import ABC, abstractmethod
from typing import Any

import torch
from rl_cbf_clf_controller.weights import Arrays
from torch import Tensor, nn

from rl_trainer.actor import Actor
from rl_trainer.parameters import TrainingParameters
from rl_trainer.replay import Batch

GRADIENT_CLIP = 1.0  # largest norm of a gradient
WARM_UP = 0.1  # an average over the last tenth of few updates, so that it forgets the untrained actor


class Learner(ABC):
    """To bring another one, derive from this, and give it an actor to walk with, `acting`, and an `update`.

    A checkpoint holds the networks, optimisers, generators and numbers that are members.
    """

    acting: Actor

    @abstractmethod
    def update(self, batch: Batch, rate: float) -> dict[str, float]:
        """One update; `rate` multiplies the learning rates. Returns named losses."""

    def set_actors(self, arrays: Arrays) -> None:
        """Give these weights to every actor; all else stays."""
        for part in vars(self).values():
            if isinstance(part, Actor):
                part.load_arrays(arrays)

    def state_dict(self) -> dict[str, Any]:
        """All that a checkpoint must hold."""
        state: dict[str, Any] = {}
        for name, part in vars(self).items():
            if isinstance(part, torch.Generator):
                state[name] = part.get_state()
            elif isinstance(part, int | float):
                state[name] = part
            elif isinstance(part, nn.Module | torch.optim.Optimizer):
                state[name] = part.state_dict()
        return state

    def load_state_dict(self, state: dict[str, Any]) -> None:
        """Go on from a checkpoint."""
        for name, part in vars(self).items():
            if isinstance(part, torch.Generator):
                part.set_state(state[name])
            elif isinstance(part, int | float):
                setattr(self, name, state[name])
            elif isinstance(part, nn.Module | torch.optim.Optimizer):
                part.load_state_dict(state[name])


class AveragedActor(Learner):
    """An actor, its optimiser, and the running average of its weights, which walks.

    `alpha_decay`: of the weights that let alpha vary with the state, a share of the learning rate.
    """

    alpha_decay = 10.0

    def __init__(self, parameters: TrainingParameters) -> None:
        self._parameters = parameters
        self.actor = Actor(parameters)
        self.acting = copy.deepcopy(self.actor).requires_grad_(False)
        self._optimizer = ClippedAdam(self.actor, parameters.actor_rate)
        self._updates = 0

    def descend(self, loss: Tensor, rate: float) -> None:
        """One step down the loss, then move the average."""
        self._optimizer.descend(loss, rate)
        self.actor.steady_alphas(self.alpha_decay * self._parameters.actor_rate * rate)
        self._updates += 1
        follow(self.acting, self.actor, max(self._parameters.polyak, 1 / (1 + WARM_UP * self._updates)))


class ClippedAdam(torch.optim.Adam):
    """Adam with a clipped gradient and a rate that can be scaled at each step."""

    def __init__(self, network: nn.Module, rate: float) -> None:
        self._weights, self._rate = list(network.parameters()), rate
        super().__init__(self._weights, lr=rate, fused=True)

    def descend(self, loss: Tensor, rate: float) -> None:
        """One step down `loss` with the learning rate times `rate`."""
        self.zero_grad()
        loss.backward(inputs=self._weights)
        nn.utils.clip_grad_norm_(self._weights, GRADIENT_CLIP)
        self.param_groups[0]["lr"] = self._rate * rate
        self.step()


@torch.no_grad()
def follow(average: nn.Module, network: nn.Module, share: float) -> None:
    """Move every weight of an average by `share` of its distance to the weight it follows."""
    torch._foreach_lerp_(list(average.parameters()), list(network.parameters()), share)
