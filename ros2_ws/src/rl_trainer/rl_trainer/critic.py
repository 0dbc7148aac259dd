"""Critics: Q of an action (alpha, beta) at a state and the mu that will be executed. All values in units of the error.

    plain    Q(s, [mu], a)   a 400-300 network, with one output, or one for each quantity
    reward   Q_i(s, mu, a) = -w_i norm(alpha_i mu + beta_i - t_i)

The second has the form of the reward; only t_i, the measured error, is unknown, and it is fitted to the reward. The
model's error is affine in mu, so t_i is affine about the QP's answer mu_qp: the noise mu - mu_qp does not depend on the
state and is small beside mu; with a slope of its own it counts.

    t_i(s, mu) = a_i(s, mu_qp) (mu - mu_qp) + b_i(s, mu_qp)         a_V = LgV A_V, the structure of [eq70]

In the first approach t depends on the whole input instead, t(s, v), v = mu + alpha mu + beta, and the gradient goes
through it.

What a critic makes of the states alone (`see`) serves every mu and action that it is asked about.
"""

from dataclasses import dataclass

import torch
from torch import Tensor, nn

from rl_trainer.networks import Scaling, hidden_layers
from rl_trainer.parameters import TrainingParameters
from rl_trainer.replay import Batch
from rl_trainer.reward import norm

NOISE = 0.2  # of a typical mu: makes exploration a factor of about one

Seen = tuple[Tensor, ...]


@dataclass(frozen=True)
class Action:
    """`alpha` (b, n, m) and `beta` (b, n) in the quantities' units; `flat` (b, (m + 1) n) over the action scales."""

    alpha: Tensor
    beta: Tensor
    flat: Tensor

    def correction(self, mu: Tensor) -> Tensor:
        """alpha mu + beta, (b, n), in the quantities' units."""
        return torch.bmm(self.alpha, mu[..., None])[..., 0] + self.beta


class PlainCritic(nn.Module):
    """A network from (s, mu, a), or (s, a), to one Q or one for each quantity."""

    def __init__(self, parameters: TrainingParameters) -> None:
        super().__init__()
        self.sees_mu, self.mu_unit = parameters.critic_sees_mu, parameters.problem.mu_unit
        self.scaling = Scaling(parameters)
        m = parameters.problem.inputs
        inputs = len(parameters.observation) + m * self.sees_mu + (m + 1) * parameters.n
        outputs = 1 if parameters.heads == "one" else parameters.n
        self.network = hidden_layers(inputs, (parameters.hidden1, parameters.hidden2), outputs)

    def see(self, batch: Batch) -> Seen:
        """The scaled observations."""
        return (self.scaling(batch.observation),)

    def forward(self, batch: Batch, seen: Seen, mu: Tensor, action: Action) -> Tensor:
        """Q, shape (b, 1) or (b, n)."""
        known = [*seen, *([mu / self.mu_unit] if self.sees_mu else [])]
        q: Tensor = self.network(torch.cat([*known, action.flat], 1))
        return q


class RewardCritic(nn.Module):
    """The reward's own form with the measured error t as the only unknown."""

    def __init__(self, parameters: TrainingParameters) -> None:
        super().__init__()
        self.norm = parameters.error_norm
        self.mu_unit = parameters.problem.mu_unit
        self.first_approach = parameters.problem.corrects_input
        self.scaling = Scaling(parameters)
        self.weight: Tensor
        self.register_buffer("weight", torch.tensor(parameters.weights))
        inputs = len(parameters.observation) + parameters.problem.inputs
        outputs = self.outputs(parameters.n, parameters.problem.inputs)
        self.network = hidden_layers(inputs, (parameters.hidden1, parameters.hidden2), outputs)

    def outputs(self, n: int, m: int) -> int:
        """Outputs of the network for n quantities and m inputs."""
        return n

    def see(self, batch: Batch) -> Seen:
        """The scaled observations."""
        return (self.scaling(batch.observation),)

    def forward(self, batch: Batch, seen: Seen, mu: Tensor, action: Action) -> Tensor:
        """Q_i, shape (b, n)."""
        correction = action.correction(mu)
        q: Tensor = -self.weight * norm(correction / batch.unit - self.target(batch, seen, mu, correction), self.norm)
        return q

    def target(self, batch: Batch, seen: Seen, mu: Tensor, correction: Tensor) -> Tensor:
        """t(s, x), the error expected where x is the input, (b, n)."""
        x = mu + correction if self.first_approach else mu
        t: Tensor = self.network(torch.cat([*seen, x / self.mu_unit], 1))
        return t


class AffineCritic(RewardCritic):
    """t affine in the exploration about the QP's answer, with V's slope contracted with LgV."""

    def outputs(self, n: int, m: int) -> int:
        """V's slope (m, m), the others' (m), and an offset each."""
        return m * m + m * (n - 1) + n

    @torch.no_grad()
    def steady_slopes(self, share: float) -> None:
        """Take `share` off the last layer's weights, not biases, of the slopes: what varies with the state decays."""
        *_, last_weight, _ = self.network.parameters()
        last_weight[: -len(self.weight)].mul_(1 - share)

    def see(self, batch: Batch) -> Seen:
        """The offset b_i (b, n) and the slope a_i (b, n, m)."""
        n, m = len(self.weight), batch.mu.shape[1]
        out: Tensor = self.network(torch.cat([*super().see(batch), batch.mu_qp / self.mu_unit], 1))
        direction = batch.LgV / (torch.linalg.vector_norm(batch.LgV, dim=1, keepdim=True) + 1)
        matrix, others, offset = out.split([m * m, m * (n - 1), n], 1)
        clf = torch.bmm(direction[:, None], matrix.reshape(-1, m, m))
        return offset, torch.cat([clf, others.reshape(len(out), n - 1, m)], 1)

    def target(self, batch: Batch, seen: Seen, mu: Tensor, correction: Tensor) -> Tensor:
        """t(s, mu), (b, n)."""
        offset, slope = seen
        return offset + torch.bmm(slope, ((mu - batch.mu_qp) / (NOISE * self.mu_unit))[..., None])[..., 0]


Critic = PlainCritic | RewardCritic


def make_critic(parameters: TrainingParameters) -> Critic:
    """The critic that the parameters name."""
    if parameters.critic == "plain":
        return PlainCritic(parameters)
    return AffineCritic(parameters) if parameters.is_affine else RewardCritic(parameters)
