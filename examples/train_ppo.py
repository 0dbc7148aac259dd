"""PPO of stable-baselines3 learns alpha and beta in 16 robots side by side; TensorBoard shows the curve."""

import sys
from typing import Any

import gymnasium
from rabbit_rivals.vec_env import SideBySide
from stable_baselines3 import PPO
from stable_baselines3.common.vec_env import VecMonitor

folder, steps = sys.argv[1], int(sys.argv[2])
robots: Any = gymnasium.make_vec("rabbit_experiments.registered:Rabbit-v0", num_envs=16, mass_scale=2.0, stones=10)
learner = PPO("MlpPolicy", VecMonitor(SideBySide([robots])), n_steps=64, seed=1, tensorboard_log=folder)
learner.learn(steps)
learner.save(f"{folder}/ppo")
