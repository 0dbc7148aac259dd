"""The gymnasium environment in the tiny world."""

import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from rl_cbf_clf_controller.uncertainty import RL_CLF_QP
from rl_trainer.environment import WalkingEnv
from rl_trainer.parameters import TrainingParameters

PARAMETERS = TrainingParameters(problem=RL_CLF_QP, sigma=0.0, relative_clf=False)


@pytest.mark.filterwarnings("ignore:.*WARN.*")
def test_check_env(toy_world: Any, toy_controller: Any) -> None:
    check_env(WalkingEnv(PARAMETERS, toy_world, toy_controller), skip_render_check=True)


@pytest.mark.filterwarnings("ignore:.*WARN.*")
def test_check_env_over_the_robot_as_the_docs_make_it() -> None:
    page = (Path(__file__).resolve().parents[4] / "docs" / "learning.md").read_text(encoding="utf-8")
    _, code = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    made: dict[str, Any] = {}
    exec(code, made)
    assert made["env"].observation_space.contains(made["observation"])
    assert made["reward"] <= 0
    check_env(made["env"], skip_render_check=True)
    made["simulation"].close()


def test_true_errors_are_the_best_action(toy_world: Any, toy_controller: Any) -> None:
    """In the tiny world Delta_2 = -I/2 and Delta_1 = 5 sin y; the corrections that say so lose next to nothing."""
    env = WalkingEnv(PARAMETERS, toy_world, toy_controller)
    alpha_scale, beta_scale, _ = PARAMETERS.scales
    totals = []
    for informed in (False, True):
        env.reset(seed=5)
        action, total, done = np.zeros(5), 0.0, False
        while not done:
            _, reward, terminated, truncated, info = env.step(action.astype(np.float32))
            total, done, LgV = total + reward, terminated or truncated, info["next_LgV"]
            size = np.linalg.norm(LgV) + 1
            alpha, beta = -LgV / 2, LgV @ (5 * np.sin(info["next_observation"][:4]))
            action = np.append(alpha / alpha_scale[0], beta / beta_scale[0]) / size * informed
        totals.append(total)
    assert totals[1] > 0.1 * totals[0]  # the first tick is not informed


def test_episode_ends_with_the_walk(toy_world: Any, toy_controller: Any) -> None:
    env = WalkingEnv(PARAMETERS, toy_world, toy_controller)
    env.reset(seed=1)
    ends = [env.step(np.zeros(5, np.float32))[2:4] for _ in range(toy_world.ticks)]
    assert ends[-1] == (False, True)
    assert not any(truncated for _, truncated in ends[:-1])
