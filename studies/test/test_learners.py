"""What the learners of stable-baselines3 and DAgger find where it is known; and sessions that go on."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from gymnasium.spaces import Box
from rabbit_description.state import Array
from rabbit_experiments.vector_environment import EpisodesEnv
from rabbit_rivals import end_to_end, residual
from rabbit_rivals.joint_targets import NetworkAbout
from rabbit_rivals.learners import actor_arrays, make
from rabbit_rivals.model_file import read
from rabbit_rivals.session import Options, SessionError
from rabbit_rivals.vec_env import SideBySide
from rl_cbf_clf_controller.network import Actor
from rl_cbf_clf_controller.weights import read as read_policy

SMALL: dict[str, dict[str, Any]] = {
    "ppo": {"batch_size": 16},
    "sac": {"batch_size": 16, "buffer_size": 400},
    "dagger": {"batch_size": 16, "buffer_size": 400, "gradient_steps": 1},
}


class OneTick(EpisodesEnv):
    """Episodes of a tick: what is read is -1 or 1, and a number beside it that only a value may read."""

    taught = 1.0

    def __init__(self, robots: int, failed: bool, reward: Any) -> None:
        super().__init__(robots, Box(-1.0, 1.0, (2,), np.float32), Box(-1.0, 1.0, (1,), np.float32))
        self._failed, self._reward, self._reads = np.full(robots, failed), reward, np.zeros((robots, 2))

    def begin(self, robots: list[int], seeds: list[int]) -> None:
        for i, seed in zip(robots, seeds, strict=True):
            self._reads[i] = np.random.default_rng(seed).choice([-1.0, 1.0], 2)

    def look(self) -> Array:
        return self._reads.copy()

    def advance(self, actions: Array) -> Array:
        wanted = np.where(np.arange(len(actions)) % 5, 0.4 * self._reads[:, 0], np.nan)
        self.infos = {"wanted": wanted[:, None]}
        self._rewards = self._reward(*self._reads.T.copy(), actions[:, 0])
        return np.ones(len(actions), dtype=bool)

    def score(self) -> tuple[Array, Array]:
        return self._rewards, self._failed


@pytest.mark.parametrize(
    ("name", "ticks", "settings"),
    [
        ("ppo", 20_000, {"learning_rate": 3e-3, "batch_size": 200}),
        ("sac", 8_000, {"learning_rate": 3e-3, "batch_size": 64, "gradient_steps": 32}),
        ("dagger", 4_000, {"learning_rate": 3e-3, "batch_size": 64, "gradient_steps": 32}),
    ],
)
def test_a_learner_finds_the_action_that_is_rewarded_or_wanted(name: str, ticks: int, settings: dict[str, Any]) -> None:
    """0.4 sign(x); DAgger's teacher has no answer for one robot of five, and a reward that says otherwise."""
    sign = -1 if name == "dagger" else 1
    robots = OneTick(40, True, lambda reads, known, said: -4 * sign * np.abs(said - 0.4 * reads) + known)
    model = make(name, SideBySide([robots]), 1, 1, 10, 32, **settings)
    model.learn(ticks)
    found = Actor(actor_arrays(model))(np.array([[-1.0], [1.0]], np.float32))
    assert found[:, 0] == pytest.approx([-0.4, 0.4], abs=0.1)
    seen, _ = model.policy.predict(np.array([[-1.0, 1.0], [1.0, -1.0]], np.float32), deterministic=True)
    assert seen == pytest.approx(found, abs=1e-5)  # what is shipped is the policy without noise


@pytest.mark.parametrize(("failed", "value"), [(True, [-1.0, 1.0]), (False, [-2.0, 2.0])])
def test_nothing_comes_after_a_fall_and_a_time_limit_goes_on(failed: bool, value: list[float]) -> None:
    """The reward is what only the value reads: with a discount of 1/2 its sum is twice that, if the episode goes on."""
    robots = OneTick(40, failed, lambda reads, known, said: known)
    model = make("ppo", SideBySide([robots]), 1, 1, 10, 32, learning_rate=3e-3, batch_size=200, gamma=0.5)
    model.learn(16_000)
    with torch.no_grad():
        values = model.policy.predict_values(torch.tensor([[1.0, -1.0], [1.0, 1.0]]))
    assert values[:, 0].numpy() == pytest.approx(value, abs=0.25)


def small(learner: str, ticks: int, seed: int = 1) -> Options:
    return Options(learner, ticks, seed, robots=4, rollout=8, hidden=8, settings=SMALL[learner])


@pytest.mark.parametrize("learner", list(SMALL))
def test_a_session_goes_on_and_refuses_another(learner: str, tmp_path: Path) -> None:
    networks = []
    for out in (tmp_path / "one", tmp_path / "other"):  # the same stops lead to the same network
        for ticks in (64, 96):
            networks += [read(end_to_end.train(small(learner, ticks), out), NetworkAbout)]
    assert [network.about.ticks for network in networks] == [64, 96, 64, 96]
    for name, values in networks[1].arrays.items():
        assert np.array_equal(values, networks[3].arrays[name])
    assert any((values != networks[0].arrays[name]).any() for name, values in networks[1].arrays.items())
    lines = (tmp_path / "one" / "curve.csv").read_text().splitlines()
    assert [line.split(",")[0] for line in lines] == ["ticks", "32", "64", "96"]
    with pytest.raises(SessionError, match="use another folder"):
        end_to_end.train(small(learner, 96, seed=2), tmp_path / "one")
    (tmp_path / "one" / "session.zip").write_bytes(b"not a session")
    with pytest.raises(SessionError, match="damaged"):
        end_to_end.train(small(learner, 128), tmp_path / "one")


@pytest.mark.parametrize("learner", ["ppo", "sac"])
def test_a_policy_within_the_step_is_written_as_one(learner: str, tmp_path: Path) -> None:
    metadata = read_policy(residual.train(small(learner, 64), tmp_path)).metadata
    assert (metadata.residual, metadata.transitions, metadata.learner) == (True, 64, learner)
