"""`--retrain`: trained once by content, in place of what is shipped; the log of episodes; episodes needed."""

from pathlib import Path

import pytest
from rabbit_description.gait import load_gaits
from rabbit_experiments.training_setup import training
from rabbit_reproduce.training import SHIPPED, TrainingJob, read_log, recipes, retrain, training_job
from rl_cbf_clf_controller.uncertainty import RL_CLF_QP
from rl_cbf_clf_controller.weights import policy_path, read
from rl_trainer.checkpoint import CheckpointError
from rl_trainer.parameters import TrainingParameters

PARAMETERS = TrainingParameters(problem=RL_CLF_QP, seed=4, episodes=1)
ONE = training_job(PARAMETERS)  # nominal, so that nothing is learned yet


def test_a_training_is_made_once_and_logged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    trained = retrain([ONE], tmp_path, 1)
    about = read(trained.policy(ONE)).metadata
    assert (about.problem, about.training_seed, about.episodes) == (RL_CLF_QP.name, 4, 1)
    assert about.command == ONE.command
    assert read(trained.policy(ONE, 1)).version == read(trained.policy(ONE)).version
    (row,) = trained.episodes()
    assert (row.problem, row.seed, row.mass_scale, row.episode) == (RL_CLF_QP.name, 4, 2.0, 1)
    assert 0 < row.kept <= row.ticks
    assert row.transitions == row.kept == about.transitions
    assert read_log(tmp_path / "episodes.csv") == [row]
    monkeypatch.setattr(TrainingJob, "do", lambda *_: pytest.fail("trained again"))
    assert retrain([ONE], tmp_path, 1) == trained


@pytest.mark.parametrize("what", ["gait", "plant", "made_with.json"])
def test_a_training_does_not_go_on_with_another_robot_or_gait(tmp_path: Path, what: str) -> None:
    gait = tmp_path / "gait.yaml"
    load_gaits(ONE.controller.gait).save(gait)
    tuning, out = ONE.controller.model_copy(update={"gait": str(gait)}), tmp_path / "out"
    for _ in range(2):
        with training(out, PARAMETERS, tuning, ONE.plant):
            pass
    plant, told = ONE.plant, "gait.yaml"
    if what == "gait":
        gait.write_text(gait.read_text() + "# a remark\n")
    elif what == "plant":
        plant, told = plant.model_copy(update={"mass_scale": 2.5}), "plant or controller"
    else:
        (out / what).write_text("{")
        told = what
    with pytest.raises(CheckpointError, match=f"begun with another .*{told}"), training(out, PARAMETERS, tuning, plant):
        pass


@pytest.mark.parametrize("quick", [True, False])
def test_what_is_shipped_is_trained_anew(quick: bool) -> None:
    made = recipes(quick)
    assert len(set(made)) == len(made)
    for name, recipe in SHIPPED.items():
        assert recipe in made
        about = read(policy_path(name)).metadata
        assert (about.problem, about.training_seed, about.plant["mass_scale"], about.episodes) == (
            *(recipe.parameters.problem.name, recipe.parameters.seed, recipe.plant.mass_scale),
            recipe.parameters.episodes,
        )
