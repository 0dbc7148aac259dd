"""PPO and SAC of stable-baselines3, and DAgger, of small networks that read the first numbers of an observation.

The network's output through tanh, without noise, is the policy that is shipped. Value networks read all of an
observation: also what no robot knows, its plant (Pinto et al., arXiv 1710.06542).
"""

import math
from typing import Any

import numpy as np
import torch
from rabbit_description.state import Array
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor, MlpExtractor
from stable_baselines3.common.vec_env import VecEnv
from stable_baselines3.sac.policies import SACPolicy
from torch import Tensor, nn

STDS = 0.05, 0.25, 0.5  # of the noise: PPO's least, at first, PPO's most
SMALL = 0.05  # times the first weights of SAC's last layer: the actor begins by saying next to nothing
HALF = 200_000  # ticks in which the share of the episodes that DAgger's teacher walks halves


class First(BaseFeaturesExtractor):
    """The first numbers of an observation."""

    def forward(self, observations: Tensor) -> Tensor:
        """(N, k) to (N, features_dim)."""
        return observations[:, : self.features_dim]


class Networks(MlpExtractor):
    """PPO's hidden layers: the value's read all of an observation, the actor's its first numbers."""

    def __init__(self, reads: int, known: int, hidden: int) -> None:
        super().__init__(known, [hidden, hidden], nn.Tanh)
        self.reads, self.policy_net = reads, MlpExtractor(reads, [hidden, hidden], nn.ReLU).policy_net

    def forward_actor(self, features: Tensor) -> Tensor:
        """See `MlpExtractor`."""
        return super().forward_actor(features[:, : self.reads])


class PpoPolicy(ActorCriticPolicy):
    """The mean goes through tanh; the noise stays within `STDS`."""

    def __init__(self, *args: Any, reads: int, hidden: int, **kwargs: Any) -> None:
        self._sizes = reads, hidden
        super().__init__(*args, **kwargs)

    def _build_mlp_extractor(self) -> None:
        self.mlp_extractor = Networks(self._sizes[0], self.features_dim, self._sizes[1])

    def _build(self, lr_schedule: Any) -> None:
        super()._build(lr_schedule)
        self.action_net: Any = nn.Sequential(self.action_net, nn.Tanh())
        with torch.no_grad():
            self.log_std.fill_(math.log(STDS[1]))

    def set_training_mode(self, mode: bool) -> None:
        """Before each rollout, and before each update."""
        super().set_training_mode(mode)
        with torch.no_grad():
            self.log_std.clamp_(math.log(STDS[0]), math.log(STDS[2]))

    @property
    def shipped(self) -> nn.Module:
        """What has the layers of the policy's mean, in their order."""
        return nn.Sequential(self.mlp_extractor.policy_net, self.action_net)


class SacPolicy(SACPolicy):
    """SAC's policy, whose actor reads the first numbers."""

    def __init__(self, *args: Any, reads: int, hidden: int, **kwargs: Any) -> None:
        self._reads = reads
        kwargs["net_arch"] = [hidden, hidden]
        super().__init__(*args, **kwargs)

    def make_actor(self, features_extractor: BaseFeaturesExtractor | None = None) -> Any:
        """See `SACPolicy`."""
        actor: Any = super().make_actor(First(self.observation_space, self._reads))
        with torch.no_grad():
            for value in [*actor.mu.parameters(), *actor.log_std.parameters()]:
                value.mul_(SMALL)
            actor.log_std.bias.fill_(math.log(STDS[1]))
        return actor

    @property
    def shipped(self) -> nn.Module:
        """See `PpoPolicy`."""
        return nn.Sequential(self.actor.latent_pi, self.actor.mu)


class Dagger(SAC):
    """DAgger (Ross, Gordon, Bagnell, arXiv 1011.0686): a student learns what its teacher would do where it walks.

    `infos` has as `wanted` the action that gives the teacher's torque, NaN where it has no answer. Torque is
    in proportion to an action, so the squared error of one is that of the other. The teacher walks a share of the
    episodes, all at first, then fewer and fewer. Of SAC there are the actor and the replay; no reward enters.
    """

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> Any:
        """Never with noise."""
        return super().predict(observation, state, episode_start, deterministic=True)

    def _on_step(self) -> None:
        assert self.env
        self.env.set_attr("taught", 0.5 ** (self.num_timesteps / HALF))

    def _store_transition(
        self, replay_buffer: ReplayBuffer, buffer_action: Any, new_obs: Any, reward: Any, dones: Any, infos: Any
    ) -> None:
        wanted = np.array([info["wanted"] for info in infos])
        super()._store_transition(replay_buffer, wanted, new_obs, reward, dones, infos)

    def train(self, gradient_steps: int, batch_size: int = 512) -> None:
        """Trains on so many minibatches; the error is 0 where the teacher had no answer."""
        assert self.replay_buffer
        for _ in range(gradient_steps):
            examples = self.replay_buffer.sample(batch_size)
            error = self.actor(examples.observations, deterministic=True) - examples.actions
            loss = error.nan_to_num().square().mean()
            self.actor.optimizer.zero_grad()
            loss.backward()
            self.actor.optimizer.step()


KINDS: dict[str, tuple[type[BaseAlgorithm], type[Any]]] = {
    "ppo": (PPO, PpoPolicy),
    "sac": (SAC, SacPolicy),
    "dagger": (Dagger, SacPolicy),
}
EVERY = {"sac": 32, "dagger": 128}  # ticks between two minibatches
SETTINGS: dict[str, dict[str, Any]] = {
    "ppo": {"batch_size": 2048, "n_epochs": 5, "target_kl": 0.02},
    "sac": {"batch_size": 256, "buffer_size": 500_000, "learning_starts": 0, "ent_coef": "auto_0.01"},
    "dagger": {"batch_size": 512, "buffer_size": 1_000_000, "learning_starts": 0},
}


def make(
    name: str, environment: VecEnv, reads: int, seed: int, rollout: int, hidden: int, **changes: Any
) -> BaseAlgorithm:
    """The learner of that name; `rollout`: ticks of each robot between two updates; `changes` of its settings."""
    kind, policy = KINDS[name]
    settings: dict[str, Any] = {"policy_kwargs": {"reads": reads, "hidden": hidden}, "seed": seed, "device": "cpu"}
    if name in EVERY:
        settings |= {"train_freq": rollout, "gradient_steps": rollout * environment.num_envs // EVERY[name]}
    else:
        settings["n_steps"] = rollout
    return kind(policy, environment, **{**settings, **SETTINGS[name], **changes})


def actor_arrays(model: BaseAlgorithm) -> dict[str, Array]:
    """`0.weight` to `2.bias` of the policy's mean."""
    policy: Any = model.policy
    linear = [layer for layer in policy.shipped.modules() if isinstance(layer, nn.Linear)]
    return {
        f"{i}.{name}": value.detach().numpy().copy()
        for i, layer in enumerate(linear)
        for name, value in layer.named_parameters()
    }
