"""PPO against what its formulas say, the plants that it walks, and a session that goes on."""

import numpy as np
import pytest
from rabbit_benchmark.families import families
from rabbit_residual.fleet import Rollout
from rabbit_residual.plants import draw_plant
from rabbit_residual.ppo import Ppo, PpoParameters, advantages
from rabbit_residual.training import options, train
from rl_cbf_clf_controller.weights import read


def rollout(reward, ended=None, failed=None) -> Rollout:
    reward = np.array(reward, dtype=float)[:, None]
    none = np.zeros_like(reward, dtype=bool)
    mark = lambda ticks: none if ticks is None else np.isin(np.arange(len(reward)), ticks)[:, None]  # noqa: E731
    nothing = np.zeros((len(reward), 1, 1))
    return Rollout(nothing, nothing, nothing, reward, mark(ended), mark(failed))


def test_with_lambda_one_an_advantage_is_the_discounted_sum_less_the_value() -> None:
    value = np.array([[0.3], [0.1], [-0.2], [0.7]])
    found = advantages(value, rollout([1.0, 2.0, 4.0, 0.0]), 0.5, 1.0)
    assert found[:, 0] == pytest.approx([1 + 1 + 1 + 0.7 / 8 - 0.3, 2 + 2 + 0.7 / 4 - 0.1, 4 + 0.35 + 0.2])


def test_nothing_comes_after_a_failure_and_a_good_end_goes_on() -> None:
    value = np.array([[0.3], [0.1], [0.7]])
    failed = advantages(value, rollout([1.0, -5.0, 0.0], ended=[1], failed=[1]), 0.9, 1.0)
    assert failed[1, 0] == pytest.approx(-5.0 - 0.1)
    walked = advantages(value, rollout([1.0, 1.0, 0.0], ended=[1]), 0.9, 1.0)
    assert walked[1, 0] == pytest.approx(1.0 + 0.9 * 0.1 - 0.1)


def test_it_learns_which_action_is_rewarded() -> None:
    """A bandit: the reward falls with the distance from 0.4 sign(x)."""
    learner = Ppo(1, 1, 1, PpoParameters(hidden=16, learning_rate=3e-3, minibatch=256), seed=1)
    rng = np.random.default_rng(2)
    for _ in range(40):
        reads = np.sign(rng.standard_normal((64, 8, 1)))
        said = np.array([learner.act(each) for each in reads])
        reward = -np.abs(said - 0.4 * reads)[:, :, 0]
        over = np.ones(reward.shape, dtype=bool)
        learner.update([Rollout(reads, np.zeros_like(reads), said, reward, over, over)])
    means = [np.mean([learner.act(np.full((200, 1), x)) for _ in range(5)]) for x in (-1.0, 1.0)]
    assert means == pytest.approx([-0.4, 0.4], abs=0.1)


@pytest.mark.parametrize("terrain", ["stones", "flat"])
def test_plants_of_the_training_are_of_development_families_alone(terrain) -> None:
    others = {
        name for each in families().families.values() if each.split != "development" for name in each.on(terrain) or {}
    }
    development = {"torque_rate", "dead_zone", "sensor_dropout"} | ({"loose_stone"} if terrain == "stones" else set())
    seen: set[str] = set()
    for seed in range(300):
        drawn = draw_plant(terrain, np.random.default_rng(seed), 5).model_dump(exclude_defaults=True)
        assert not others & drawn.keys()
        seen |= drawn.keys()
    assert development <= seen


@pytest.mark.parametrize("learner", ["ppo", "sac"])
def test_a_session_goes_on(learner, tmp_path) -> None:
    small = {"robots": 4, "rollout": 5}
    first = read(train(options(learner, ticks=40, **small), tmp_path, tell=lambda line: None))
    assert (first.metadata.transitions, first.metadata.learner) == (40, learner)
    second = read(train(options(learner, ticks=60, **small), tmp_path, tell=lambda line: None))
    assert second.metadata.transitions == 60
    lines = (tmp_path / "curve.csv").read_text().splitlines()
    assert [line.split(",")[0] for line in lines] == ["ticks", "20", "40", "60"]
