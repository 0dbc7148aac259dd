"""DDPG as it works here: a deterministic policy gradient through a critic that has the reward's form.

    critic: fit   Q_i(s, mu, a) = -(alpha_i mu + beta_i - t_i(s, mu))^2   to the rewards of sampled actions a
    actor:  ascend  sum_i Q_i(s, mu, pi(s))                                      all in units of the error

The reward of a tick depends on the estimates of that tick alone, so there is no discount: this is a contextual bandit.
The measured error does not depend on the action, so the reward of any action at a transition is known; each minibatch
draws actions about the actor's. Only t_i, the measured error, is unknown to the critic. The model's error is affine in
mu, so t_i is affine about the QP's answer mu_qp: the noise mu - mu_qp does not depend on the state and is small beside
mu; with a further slope it counts.

    t_i(s, mu) = a_i(s, mu_qp) (mu - mu_qp) + b_i(s, mu_qp)         a_V = LgV A_V, the structure of [eq70]

In the first approach t depends on the whole input instead, t(s, v), v = mu + alpha mu + beta, and the gradient goes
through it. The paper's DDPG is in `paper_ddpg.py`.
"""

import torch
from torch import Tensor, nn

from rl_trainer.actor import Scaling, hidden_layers
from rl_trainer.learner import AveragedActor, ClippedAdam
from rl_trainer.parameters import TrainingParameters
from rl_trainer.replay import Batch

NOISE = 0.2  # of a typical mu: makes exploration a factor of about one
SAMPLED_ACTION = 0.3  # deviation of sampled actions from the actor's, outputs' unit
SAMPLED_MU = 0.4  # of a typical mu: deviation of the mu that a sampled action is asked for in the first approach

Seen = tuple[Tensor, ...]


def correction(alpha: Tensor, beta: Tensor, mu: Tensor) -> Tensor:
    """alpha mu + beta, (b, n), of alpha (b, n, p), beta (b, n) and mu (b, p)."""
    return torch.bmm(alpha, mu[..., None])[..., 0] + beta


class RewardCritic(nn.Module):
    """The reward's form with the measured error t as the only unknown, a network of (s, mu).

    What it makes of the states alone (`see`) serves every mu and action that it is asked about.
    """

    def __init__(self, parameters: TrainingParameters) -> None:
        super().__init__()
        self.n, self.mu_unit = parameters.n, parameters.problem.mu_unit
        self.first_approach = parameters.problem.corrects_input
        self.scaling = Scaling(parameters)
        m = parameters.problem.inputs
        self.network = hidden_layers(len(parameters.observation) + m, parameters, self.outputs(m))

    def outputs(self, m: int) -> int:
        """The number of the network's outputs, for m inputs."""
        return self.n

    def see(self, batch: Batch) -> Seen:
        """The scaled observations."""
        return (self.scaling(batch.observation),)

    def forward(self, batch: Batch, seen: Seen, mu: Tensor, alpha: Tensor, beta: Tensor) -> Tensor:
        """Q_i, shape (b, n), of alpha (b, n, p) and beta (b, n) in the quantities' units."""
        corrected = correction(alpha, beta, mu)
        t = self.target(batch, seen, mu + corrected if self.first_approach else mu)
        return self.reward(corrected / batch.unit - t)

    def reward(self, error: Tensor) -> Tensor:
        """The reward of a scaled error (b, n)."""
        return -(error * error)

    def target(self, batch: Batch, seen: Seen, x: Tensor) -> Tensor:
        """t(s, x), the error expected where x is the input, (b, n)."""
        return self.network(torch.cat([*seen, x / self.mu_unit], 1))

    def steady_slopes(self, share: float) -> None:
        """Does nothing: here nothing varies with the state that should not."""


class AffineCritic(RewardCritic):
    """t affine in the exploration about the QP's answer, with V's slope contracted with LgV."""

    def outputs(self, m: int) -> int:
        """V's slope (m, m), the others' (m), and an offset each."""
        return m * m + m * (self.n - 1) + self.n

    @torch.no_grad()
    def steady_slopes(self, share: float) -> None:
        """Take `share` off the last layer's weights, not biases, of the slopes: what varies with the state decays."""
        *_, last_weight, _ = self.network.parameters()
        last_weight[: -self.n].mul_(1 - share)

    def see(self, batch: Batch) -> Seen:
        """The offset b_i (b, n) and the slope a_i (b, n, m)."""
        n, m = self.n, batch.mu.shape[1]
        out: Tensor = self.network(torch.cat([*super().see(batch), batch.mu_qp / self.mu_unit], 1))
        direction = batch.LgV / (torch.linalg.vector_norm(batch.LgV, dim=1, keepdim=True) + 1)
        matrix, others, offset = out.split([m * m, m * (n - 1), n], 1)
        clf = torch.bmm(direction[:, None], matrix.reshape(-1, m, m))
        return offset, torch.cat([clf, others.reshape(len(out), n - 1, m)], 1)

    def target(self, batch: Batch, seen: Seen, x: Tensor) -> Tensor:
        """t(s, mu), (b, n)."""
        offset, slope = seen
        return correction(slope, offset, (x - batch.mu_qp) / (NOISE * self.mu_unit))


class Ddpg(AveragedActor):
    """Actor, its average, which walks, and critic."""

    def __init__(self, parameters: TrainingParameters) -> None:
        super().__init__(parameters)
        self._critic = self.make_critic(parameters)
        self._critic_optimizer = ClippedAdam(self._critic, parameters.critic_rate)
        self._generator = torch.Generator().manual_seed(parameters.seed + 1)

    def make_critic(self, parameters: TrainingParameters) -> RewardCritic:
        """Affine, where mu itself is the input."""
        return (AffineCritic if parameters.problem.has_clf else RewardCritic)(parameters)

    def update(self, batch: Batch, rate: float) -> dict[str, float]:
        """One step of the critic, then one of the actor."""
        p, size = self._parameters, self.actor.clf_size(batch.LgV)
        action = self.actor.unit_action(batch.observation, batch.LgV, size)
        seen = self._critic.see(batch)
        mu, alpha, beta, reward = self.sample(batch, size, action.detach())
        critic_loss = nn.functional.smooth_l1_loss(self._critic(batch, seen, mu, alpha, beta), reward)
        self._critic_optimizer.descend(critic_loss, rate)
        self._critic.steady_slopes(self.alpha_decay * p.critic_rate * rate)
        seen = tuple(part.detach() for part in seen)  # an affine critic has said it all before this step
        probe = batch.mu
        if isinstance(self._critic, AffineCritic):  # it knows of any mu about mu_qp
            probe = batch.mu_qp + p.probe_noise * self._noise(batch.mu)
        actor_loss = -self._critic(batch, seen, probe, *self.actor.in_units(action, size)).sum(1).mean()
        self.descend(actor_loss, rate)
        return {"critic": critic_loss.item(), "actor": actor_loss.item()}

    @torch.no_grad()
    def sample(self, batch: Batch, size: Tensor, action: Tensor) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        """The mu that another action is asked for, its alpha and beta, and the reward that it would have had.

        In the first approach the same input v was measured; it is what another action makes of another mu.
        """
        mu, (alpha, beta) = batch.mu, self.actor.in_units(action + SAMPLED_ACTION * self._noise(action), size)
        if self._parameters.problem.corrects_input:
            v = mu + correction(batch.alpha, batch.beta, mu)
            mu = mu + SAMPLED_MU * self._parameters.problem.mu_unit * self._noise(mu)
            beta = v - mu - torch.einsum("bij,bj->bi", alpha, mu)
        return mu, alpha, beta, self._critic.reward(correction(alpha, beta, mu) / batch.unit - batch.target)

    def _noise(self, like: Tensor) -> Tensor:
        return torch.randn(like.shape, generator=self._generator)
