"""The three-link walker of the examples, run short: nominal, oracle and learned at twice its mass."""

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from rl_trainer.transitions import Doubt

EXAMPLES = Path(__file__).parents[2] / "examples"
STEPS = 12


@pytest.fixture(scope="module")
def example():
    spec = importlib.util.spec_from_file_location("three_link_walker", EXAMPLES / "three_link_walker.py")
    module = importlib.util.module_from_spec(spec)
    sys.modules["three_link_walker"] = module
    spec.loader.exec_module(module)
    return module


def test_the_gait_repeats(example):
    step = example.RepeatedStep(example.WALKER, example.PATH)
    assert step.exists
    assert 0 < step.eigenvalue < 0.9
    q, dq = example.WALKER.after_impact(step.instants[-1].q, step.instants[-1].dq)
    assert np.concatenate([q, dq]) == pytest.approx(np.concatenate(step.start), abs=1e-7)


@pytest.mark.parametrize("seed", [1, 2])
def test_at_twice_the_mass_the_oracle_walks_and_the_nominal_falls(example, seed):
    assert example.walk(example.URDF, seed, STEPS) == STEPS
    assert example.walk(example.HEAVY, seed, STEPS) <= STEPS / 2
    assert example.walk(example.HEAVY, seed, STEPS, oracle=True) == STEPS


def test_the_oracles_estimates_are_what_is_measured(example):
    """But for what changes within a tick."""
    assert example.walk(example.HEAVY, 3, 6, oracle=True, sigma=1.0) == 6
    errors, targets = (
        np.array([getattr(item, name)[0] for item in example.TICKS.transitions]) for name in ("error", "target")
    )
    assert np.sqrt(np.mean(errors**2)) < 0.03 * np.sqrt(np.mean(targets**2))


@pytest.mark.timeout(600)  # s, on a busy machine
def test_a_short_training_finds_most_of_the_error(example, capsys):
    """Held out: steps of the oracle's walk, which no training saw; 1 is the nominal controller's error."""
    policy = example.train(seed=1, episodes=4)
    assert "episode 4" in capsys.readouterr().out
    example.walk(example.HEAVY, example.EVALUATION, 6, oracle=True, sigma=1.0)
    sound = [item for item in example.TICKS.transitions if not item.doubt & ~Doubt.SATURATED]
    error = [policy.act(item.observation, item.LgV).error(item.mu)[0] - item.target[0] for item in sound]
    assert np.linalg.norm(error) < 0.3 * np.linalg.norm([item.target[0] for item in sound])
    assert example.walk(example.HEAVY, example.EVALUATION, 6, policy) == 6


def test_a_seed_gives_the_same_walk(example):
    walks = []
    for _ in range(2):
        example.walk(example.HEAVY, 5, 2, sigma=1.0)
        walks.append([item.measured for item in example.TICKS.transitions])
    np.testing.assert_array_equal(*walks)


def test_it_says_what_it_found(example, capsys):
    example.main(episodes=1, seeds=2, steps=2, walks=1)
    out = capsys.readouterr().out
    assert "nominal, true mass as in the model: 2.0 steps of 2" in out
    assert "seed 2, episode 1:" in out
