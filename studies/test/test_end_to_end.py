"""A session end to end that was stopped goes on where it stood."""

import csv
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rabbit_rivals import end_to_end
from rabbit_rivals.end_to_end import COLUMNS, EndToEndOptions, SessionError, train
from rabbit_rivals.joint_targets import NetworkAbout
from rabbit_rivals.model_file import read
from stable_baselines3 import PPO, SAC

LINE, TICKS = 256, 768  # of a line of the curve, of the session; two rollouts of PPO are a line
SMALL = {
    "ppo": {"n_steps": 16, "batch_size": 64},
    "sac": {"learning_starts": 64, "batch_size": 32, "buffer_size": 2000},
}


@pytest.fixture(autouse=True)
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(end_to_end, "EVALUATION", LINE)
    monkeypatch.setattr(end_to_end, "JUDGED", 1)
    monkeypatch.setattr(end_to_end, "PPO_SETTINGS", end_to_end.PPO_SETTINGS | SMALL["ppo"])
    monkeypatch.setattr(end_to_end, "SAC_SETTINGS", end_to_end.SAC_SETTINGS | SMALL["sac"])


def stop(line: str) -> None:
    raise KeyboardInterrupt


def lines(out: Path) -> list[list[str]]:
    head, *found = list(csv.reader((out / "curve.csv").open()))
    assert head == list(COLUMNS)
    return found


def learner(out: Path, name: str, steps: int) -> Any:
    return {"ppo": PPO, "sac": SAC}[name].load(out / f"checkpoint-{steps}.zip", device="cpu")


def updates(model: Any, name: str) -> float:
    """How many steps the optimiser of the actor has made."""
    optimiser = model.policy.optimizer if name == "ppo" else model.actor.optimizer
    return next(iter(optimiser.state_dict()["state"].values()))["step"].item()


@pytest.mark.parametrize("name", ["ppo", "sac"])
def test_a_session_that_was_stopped_goes_on_to_the_ticks_that_were_asked_for(name: str, tmp_path: Path) -> None:
    options = EndToEndOptions(learner=name, steps=TICKS, seed=1)
    with pytest.raises(KeyboardInterrupt):
        train(options, tmp_path, stop)
    (first,) = lines(tmp_path)
    assert first[0] == str(LINE)
    before = updates(learner(tmp_path, name, LINE), name)
    (tmp_path / "checkpoint-512.zip").write_text("as a session leaves it that is stopped while it writes")
    (tmp_path / "curve.csv").unlink()

    policy = train(options, tmp_path)
    assert [line[0] for line in lines(tmp_path)] == ["256", "512", "768"]
    assert lines(tmp_path)[0] == first
    hours = [float(line[1]) for line in lines(tmp_path)]
    assert hours == sorted(hours)
    model = learner(tmp_path, name, TICKS)
    assert model.num_timesteps == TICKS
    if name == "sac":
        model.load_replay_buffer(tmp_path / f"checkpoint-{TICKS}.pkl")
        assert model.replay_buffer.size() == TICKS / end_to_end.ENVIRONMENTS
        assert updates(model, name) == (TICKS - 64) / end_to_end.ENVIRONMENTS
    else:
        assert updates(model, name) > before
    assert read(policy, NetworkAbout).about.steps in (256, 512, 768)

    written = (tmp_path / "progress.json").read_bytes()
    train(options, tmp_path, stop)  # there is nothing left to do
    assert (tmp_path / "progress.json").read_bytes() == written


def test_the_same_stops_lead_to_the_same_network(tmp_path: Path) -> None:
    def network(out: Path) -> dict[str, Any]:
        for steps in (LINE, 2 * LINE):
            train(EndToEndOptions(learner="sac", steps=steps, seed=3), out)
        return end_to_end.network(learner(out, "sac", 2 * LINE), "sac")

    one, other = network(tmp_path / "one"), network(tmp_path / "other")
    assert all(np.array_equal(one[key], other[key]) for key in one)


def test_another_session_or_a_lost_checkpoint_is_refused(tmp_path: Path) -> None:
    train(EndToEndOptions(learner="ppo", steps=LINE, seed=1), tmp_path)
    with pytest.raises(SessionError, match="another folder"):
        train(EndToEndOptions(learner="sac", steps=LINE, seed=1), tmp_path)
    (tmp_path / "checkpoint-256.zip").unlink()
    with pytest.raises(SessionError, match="not there"):
        train(EndToEndOptions(learner="ppo", steps=TICKS, seed=1), tmp_path)
