"""SAC and DAgger against what their formulas say; a session that was stopped goes on where it stood."""

from pathlib import Path

import numpy as np
import pytest
import torch
from rabbit_residual.fleet import Rollout
from rabbit_residual.ppo import PpoParameters
from rabbit_residual.sac import Sac, SacParameters
from rabbit_residual.session import SessionError
from rabbit_rivals.dagger import Dagger, DaggerParameters
from rabbit_rivals.end_to_end import Options, options, train
from rabbit_rivals.joint_targets import NetworkAbout
from rabbit_rivals.model_file import read
from rl_cbf_clf_controller.network import Actor

SMALL = {
    "ppo": PpoParameters(hidden=8, minibatch=16),
    "sac": SacParameters(hidden=8, batch=16, first=40, every=8),
    "dagger": DaggerParameters(hidden=8, batch=16, every=8, half=100),
}


def small(learner: str, ticks: int, seed: int = 1) -> Options:
    return options(learner, ticks=ticks, seed=seed, robots=4, rollout=8, learner=SMALL[learner])


def quiet(line: str) -> None:
    pass


def bandit(learner: Sac, reward, rounds: int) -> None:
    """Ticks that stand alone: what was read is -1 or 1, each ends an episode badly, so nothing follows."""
    rng = np.random.default_rng(2)
    for _ in range(rounds):
        reads = np.sign(rng.standard_normal((9, 16, 1)))
        known = np.sign(rng.standard_normal(reads.shape))
        said = np.array([learner.act(each) for each in reads])
        over = np.ones(reads.shape[:2], dtype=bool)
        learner.update([Rollout(reads, known, said, reward(reads, known, said)[:, :, 0], over, over)])


def test_sac_learns_which_action_is_rewarded_and_keeps_its_entropy() -> None:
    """The reward falls with the distance from 0.4 sign(x); the temperature holds an entropy of -1 nat."""
    learner = Sac(1, 1, 1, SacParameters(hidden=32, learning_rate=3e-3, batch=64, every=4, first=256), seed=1)
    bandit(learner, lambda reads, known, said: -4 * np.abs(said - 0.4 * reads), 60)
    actor = Actor(learner.arrays())
    assert actor(np.array([[-1.0], [1.0]], np.float32))[:, 0] == pytest.approx([-0.4, 0.4], abs=0.1)
    with torch.no_grad():
        _, log_p, _ = learner._sampled(torch.tensor([[-1.0], [1.0]] * 2000))
    assert -float(log_p.mean()) == pytest.approx(-1.0, abs=0.35)


def test_a_student_learns_what_its_teacher_says_and_nothing_where_it_says_nothing() -> None:
    """0.4 sign(x) where there is an answer, whatever comes of it; the teacher's share halves each 1,000 ticks."""
    student, rng = Dagger(1, 1, DaggerParameters(hidden=32, learning_rate=3e-3, every=4, half=1000), seed=1), np.random
    for round_ in range(20):
        reads = np.sign(rng.default_rng(round_).standard_normal((11, 10, 1)))
        said = np.where(rng.default_rng(round_).random(reads.shape) < 0.2, np.nan, 0.4 * reads)
        over = np.zeros(reads.shape[:2], dtype=bool)
        taught, _ = student.update([Rollout(reads, reads, said, -said[:, :, 0], over, over)])
        assert taught == pytest.approx(0.5 ** (round_ / 10))
    both = np.array([[-1.0], [1.0]], np.float32)
    assert Actor(student.arrays())(both)[:, 0] == pytest.approx([-0.4, 0.4], abs=0.02)
    assert student.act(both) == pytest.approx(Actor(student.arrays())(both))


@pytest.mark.parametrize("learner", list(SMALL))
def test_a_session_goes_on_and_refuses_another(learner: str, tmp_path: Path) -> None:
    first = read(train(small(learner, 96), tmp_path, quiet), NetworkAbout)
    assert first.about.ticks == 96
    state = torch.load(tmp_path / "session.pt", weights_only=True)["learner"]
    assert steps(state) > 0
    second = read(train(small(learner, 192), tmp_path, quiet), NetworkAbout)
    assert second.about.ticks == 192
    assert steps(torch.load(tmp_path / "session.pt", weights_only=True)["learner"]) > steps(state)
    lines = (tmp_path / "curve.csv").read_text().splitlines()
    assert [line.split(",")[0] for line in lines] == ["ticks", *map(str, range(32, 193, 32))]
    with pytest.raises(SessionError, match="use another folder"):
        train(small(learner, 192, seed=2), tmp_path, quiet)
    (tmp_path / "session.pt").write_bytes(b"not a session")
    with pytest.raises(SessionError, match="damaged"):
        train(small(learner, 192), tmp_path, quiet)


def steps(state) -> float:
    """That the actor's optimiser has made."""
    adam = state["adam"] if "adam" in state else state["adams"][0]
    return next(iter(adam["state"].values()), {"step": torch.tensor(0.0)})["step"].item()


@pytest.mark.parametrize("learner", list(SMALL))
def test_the_same_stops_lead_to_the_same_network(learner: str, tmp_path: Path) -> None:
    def network(out: Path) -> dict[str, np.ndarray]:
        for ticks in (96, 160):
            path = train(small(learner, ticks, seed=3), out, quiet)
        return read(path, NetworkAbout).arrays

    one, other = network(tmp_path / "one"), network(tmp_path / "other")
    assert all(np.array_equal(one[key], other[key]) for key in one)
