"""The episode loop in a tiny world: resuming, checkpoints, what the folder holds."""

import csv
import itertools
from pathlib import Path

import pytest
import torch
from rl_cbf_clf_controller.uncertainty import RL_CLF_QP
from rl_cbf_clf_controller.weights import PolicyFile, read
from rl_trainer import training
from rl_trainer.checkpoint import CHECKPOINT, CURVE, Checkpoint, CheckpointError
from rl_trainer.parameters import TrainingParameters
from rl_trainer.session import resume
from rl_trainer.training import DivergenceError, Provenance, Trainer
from tiny_world import ToyController, ToyWorld

PARAMETERS = TrainingParameters(
    problem=RL_CLF_QP, episodes=4, nominal_episodes=1, batch=16, updates_least=10, hidden1=16, hidden2=12
)


def test_a_killed_run_resumes_with_nothing_lost(tmp_path: Path) -> None:
    whole = Checkpoint(tmp_path / "whole", Trainer(PARAMETERS))
    reports = list(resume(whole, ToyWorld(), ToyController))
    cut = Checkpoint(tmp_path / "cut", Trainer(PARAMETERS))
    seen = list(itertools.islice(resume(cut, ToyWorld(), ToyController), 2))
    half = tmp_path / "cut" / f".{'0' * 32}.checkpoint.pt"
    half.write_bytes(b"killed here")
    again = Checkpoint(tmp_path / "cut", Trainer(PARAMETERS))
    assert len(again.trainer.reports) == 2
    assert not half.exists()
    seen += list(resume(again, ToyWorld(), ToyController))
    assert seen == reports
    assert again.trainer.reports == reports
    assert all(report.seconds > 0 for report in again.trainer.reports)
    assert again.trainer.policy_file().encode() == whole.trainer.policy_file().encode()
    curve, other = ((folder / CURVE).read_text() for folder in (whole.folder, again.folder))
    assert curve == other
    rows = list(csv.DictReader(curve.splitlines()))
    assert [int(row.pop("episode")) for row in rows] == [0, 1, 2, 3]
    for row, report in zip(rows, reports, strict=True):
        assert {name: float(text) for name, text in row.items() if text} == report.scalars
    assert not list(resume(Checkpoint(tmp_path / "cut", Trainer(PARAMETERS)), ToyWorld(), ToyController))
    with pytest.raises(CheckpointError, match="other parameters"):
        Checkpoint(tmp_path / "cut", Trainer(PARAMETERS.model_copy(update={"seed": 2})))


def test_a_killed_run_that_began_with_a_policy_resumes_with_nothing_lost(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Whether or not who goes on names the policy again; it is killed before its critic knows something."""
    monkeypatch.setattr(training, "CRITIC_FIRST", 60)
    given = Trainer(PARAMETERS.model_copy(update={"seed": 2})).policy_file()
    metadata = given.metadata.model_copy(update={"transitions": 5000})  # which more than halves the learning rates

    def begun(name: str, is_named: bool = True) -> Checkpoint:
        trainer = Trainer(PARAMETERS)
        if is_named:
            trainer.start_from(PolicyFile(metadata, given.arrays))
        return Checkpoint(tmp_path / name, trainer)

    whole = begun("whole")
    reports = list(resume(whole, ToyWorld(), ToyController))
    for name, is_named in (("named", True), ("unnamed", False)):
        assert list(itertools.islice(resume(begun(name), ToyWorld(), ToyController), 1)) == reports[:1]
        again = begun(name, is_named)
        assert list(resume(again, ToyWorld(), ToyController)) == reports[1:]
        assert again.trainer.policy_file().encode() == whole.trainer.policy_file().encode()


def test_learning_that_diverges_keeps_the_checkpoint(tmp_path: Path) -> None:
    trainer = Trainer(PARAMETERS)
    reports = resume(Checkpoint(tmp_path, trainer), ToyWorld(), ToyController)
    next(reports)
    kept = (tmp_path / CHECKPOINT).read_bytes()
    with torch.no_grad():
        for weight in trainer.learner.acting.parameters():
            weight.fill_(torch.nan)
    with pytest.raises(DivergenceError, match=r"by the end of episode 1.*not finite.*learning rates"):
        next(reports)
    assert (tmp_path / CHECKPOINT).read_bytes() == kept
    assert Checkpoint(tmp_path, Trainer(PARAMETERS)).trainer.episode == 1


def test_a_damaged_checkpoint_is_refused(tmp_path: Path) -> None:
    """One bit is wrong. Any other: `tests/fuzz`."""
    list(itertools.islice(resume(Checkpoint(tmp_path, Trainer(PARAMETERS)), ToyWorld(), ToyController), 1))
    data = bytearray((tmp_path / CHECKPOINT).read_bytes())
    data[999] ^= 4
    (tmp_path / CHECKPOINT).write_bytes(data)
    with pytest.raises(CheckpointError, match=r"checkpoint\.pt: damaged"):
        Checkpoint(tmp_path, Trainer(PARAMETERS))


def test_the_folder_holds_a_policy_an_episode(tmp_path: Path) -> None:
    trainer = Trainer(PARAMETERS, Provenance(plant={"mass_scale": 2.0}, commit="abc", command="rabbit train"))
    reports = list(resume(Checkpoint(tmp_path, trainer), ToyWorld(), ToyController))
    files = sorted((tmp_path / "policies").iterdir())
    assert [file.stem for file in files] == ["001", "002", "003", "004"]
    metadata = read(files[-1]).metadata
    assert (metadata.episodes, metadata.commit, metadata.plant) == (4, "abc", {"mass_scale": 2.0})
    assert metadata.transitions == sum(report.kept for report in reports)
    assert any((tmp_path / "tensorboard").iterdir())


def test_schedule_depends_on_seed_and_episode_alone() -> None:
    first, second = Trainer(PARAMETERS), Trainer(PARAMETERS)
    for _ in range(3):
        second.begin_episode()
    second.episode = first.episode = 7
    a, b = first.begin_episode(), second.begin_episode()
    assert (a.seed, a.sigma) == (b.seed, b.sigma)
    assert a.sigma in {PARAMETERS.sigma * factor for factor in PARAMETERS.sigma_factors}
    second.episode = 8
    assert second.begin_episode().seed != a.seed
