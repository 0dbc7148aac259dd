"""DDPG of stable-baselines3 on the estimation problem, in place of this project's, through `rl_trainer`'s environment.

The same plant, controller, noise, network (400-300) and reward as the paper's learner has; the action is alpha and
beta, 25 values on stones, without the structured form. gamma is 0: what an estimate earns depends on its own tick
alone. The result is an ordinary policy file.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch
from rabbit_description.gait import load_gaits
from rabbit_experiments import provenance
from rabbit_experiments.assembly import make_simulation
from rabbit_experiments.conditions import TRAINING_PLANT, TRAINING_SLACK_WEIGHT
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.controller import Controller
from rl_cbf_clf_controller.parameters import load_parameters
from rl_cbf_clf_controller.policy import Policy
from rl_cbf_clf_controller.problem import Problem
from rl_cbf_clf_controller.weights import PROBE, Actor, Arrays, PolicyFile, PolicyMetadata, probe_inputs, problem_fields
from rl_trainer.environment import WalkingEnv
from rl_trainer.parameters import TrainingParameters
from torch import nn

ACTION_NOISE = 0.1  # of actions in [-1, 1]
TICKS_A_LINE = 2000  # of what is printed


def train(
    problem: Problem | str, steps: int, seed: int, out: Path, command: str, tell: Callable[[str], None] = print
) -> PolicyFile:
    """So many ticks of walking and as many updates; the policy is written to `out`, the last one.

    Raises:
        ModuleNotFoundError: stable-baselines3 is not installed.
    """
    from stable_baselines3 import DDPG
    from stable_baselines3.common.noise import NormalActionNoise

    torch.set_num_threads(1)
    parameters = TrainingParameters.model_validate({"problem": problem, "seed": seed, "structured": False})
    env = estimation_env(parameters)
    actions = (parameters.problem.inputs + 1) * parameters.n
    model = DDPG(
        "MlpPolicy",
        env,
        policy_kwargs={"net_arch": [400, 300], "activation_fn": nn.ReLU},
        action_noise=NormalActionNoise(np.zeros(actions), np.full(actions, ACTION_NOISE)),
        gamma=0.0,
        learning_rate=1e-3,
        batch_size=128,
        learning_starts=1000,
        seed=seed,
        device="cpu",
    )

    def tell_now_and_then(of_learning: dict[str, Any], _: dict[str, Any]) -> bool:
        last = model.ep_info_buffer
        if model.num_timesteps % TICKS_A_LINE == 0 and last:
            ticks = np.array([each["l"] for each in last])
            reward = np.array([each["r"] for each in last]) / ticks
            tell(f"ticks {model.num_timesteps}, episodes' ticks {ticks.mean():.0f}, reward {reward.mean():.3g}")
        return True

    model.learn(steps, tell_now_and_then)
    file = policy_file(model, parameters, steps, command)
    file.write(out)
    return file


def estimation_env(parameters: TrainingParameters) -> WalkingEnv:
    """The walk that `rabbit train` learns from."""
    tuning = load_parameters("ours", controller=parameters.problem.name, slack_weight=TRAINING_SLACK_WEIGHT)
    gait = load_gaits(tuning.gait)
    plant = SimulationParameters.model_validate(
        {**TRAINING_PLANT, "terrain": tuning.terrain, "stones": parameters.walking_steps}
    )

    def make_controller(policy: Policy, sigma: float) -> Controller:
        return Controller(tuning.model_copy(update={"sigma": sigma}), gait, policy)

    return WalkingEnv(parameters, make_simulation(plant, gait), make_controller)


def policy_file(model: Any, parameters: TrainingParameters, steps: int, command: str) -> PolicyFile:
    """The actor of a stable-baselines3 model as a policy file."""
    arrays: Arrays = {}
    for i, layer in enumerate(each for each in model.policy.actor.mu if isinstance(each, nn.Linear)):
        arrays[f"{i}.weight"] = layer.weight.detach().numpy().copy()
        arrays[f"{i}.bias"] = layer.bias.detach().numpy().copy()
    actor = Actor(arrays)
    arrays[PROBE] = np.stack([actor(row) for row in probe_inputs(len(parameters.observation))])
    center, scale = np.array([parameters.problem.unit(name) for name in parameters.observation]).T
    alpha, beta, _ = parameters.scales
    metadata = PolicyMetadata(
        **problem_fields(parameters.problem),
        observation=parameters.observation,
        observation_center=tuple(center.tolist()),
        observation_scale=tuple(scale.tolist()),
        structured=False,
        alpha_scale=alpha,
        beta_scale=beta,
        learner="stable-baselines3 DDPG",
        plant=dict(TRAINING_PLANT),
        training_seed=parameters.seed,
        episodes=model._episode_num,
        transitions=steps,
        commit=provenance.commit(),
        command=command,
    )
    return PolicyFile(metadata, arrays)
