"""Critics: Q of an action (alpha, beta) at a state and the mu that will be executed. All values in units of the error.

    plain    Q(s, [mu], a)   a 400-300 network, with one output, or one for each quantity
    reward   Q_i(s, mu, a) = -w_i norm(alpha_i mu + beta_i - t_i(s, x))       x = mu

The second has the reward's own form; only t_i, a 400-300 network, is unknown, and it is fitted to the reward. In the
first approach t depends on the whole input instead, x = v = mu + alpha mu + beta, and the gradient goes through it.
"""

from dataclasses import dataclass

import torch
from rl_cbf_clf_controller.uncertainty import INPUTS, Problem
from torch import Tensor, nn

from rl_trainer.networks import MU_UNIT, Scaling, hidden_layers
from rl_trainer.parameters import TrainingParameters
from rl_trainer.reward import norm


@dataclass(frozen=True)
class Action:
    """`alpha` (b, n, 4) and `beta` (b, n) in the quantities' units; `flat` (b, 5n) over the action scales."""

    alpha: Tensor
    beta: Tensor
    flat: Tensor

    def correction(self, mu: Tensor) -> Tensor:
        """alpha mu + beta, (b, n), in the quantities' units."""
        return torch.einsum("bij,bj->bi", self.alpha, mu) + self.beta


class PlainCritic(nn.Module):
    """A network from (s, mu, a), or (s, a), to one Q or one for each quantity."""

    def __init__(self, parameters: TrainingParameters) -> None:
        super().__init__()
        self.sees_mu = parameters.critic_sees_mu
        self.scaling = Scaling(parameters.observation)
        actions = (INPUTS + 1) * parameters.n
        inputs = len(parameters.observation) + INPUTS * self.sees_mu + actions
        outputs = 1 if parameters.heads == "one" else parameters.n
        self.network = hidden_layers(inputs, (parameters.hidden1, parameters.hidden2), outputs)

    def forward(self, observation: Tensor, mu: Tensor, unit: Tensor, action: Action) -> Tensor:
        """Q, shape (b, 1) or (b, n); `unit` is not used."""
        known = [self.scaling(observation), *([mu / MU_UNIT] if self.sees_mu else [])]
        q: Tensor = self.network(torch.cat([*known, action.flat], 1))
        return q


class RewardCritic(nn.Module):
    """The reward's own form with the measured error as the only unknown."""

    def __init__(self, parameters: TrainingParameters) -> None:
        super().__init__()
        self.io = parameters.problem is Problem.IO_RL_CLF_QP
        self.norm = parameters.error_norm
        self.scaling = Scaling(parameters.observation)
        self.weight: Tensor
        self.register_buffer("weight", torch.tensor(parameters.weights))
        inputs = len(parameters.observation) + INPUTS
        self.network = hidden_layers(inputs, (parameters.hidden1, parameters.hidden2), parameters.n)

    def forward(self, observation: Tensor, mu: Tensor, unit: Tensor, action: Action) -> Tensor:
        """Q_i, shape (b, n)."""
        correction = action.correction(mu)
        t = self.target(observation, mu + correction if self.io else mu)
        q: Tensor = -self.weight * norm(correction / unit - t, self.norm)
        return q

    def target(self, observation: Tensor, x: Tensor) -> Tensor:
        """t(s, x), the error expected where x (b, 4) is executed, (b, n)."""
        t: Tensor = self.network(torch.cat([self.scaling(observation), x / MU_UNIT], 1))
        return t


Critic = PlainCritic | RewardCritic


def make_critic(parameters: TrainingParameters) -> Critic:
    """The critic that the parameters name."""
    return RewardCritic(parameters) if parameters.critic == "reward" else PlainCritic(parameters)
