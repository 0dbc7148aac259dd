"""A setting of what the paper does not print: where it counts, what it refuses."""

from dataclasses import replace
from pathlib import Path

import pytest
from rabbit_reproduce.commands.reproduce import app
from rabbit_reproduce.controllers import CBF_CLF, RL_CBF_CLF, RL_CLF
from rabbit_reproduce.setting import SETTINGS, Setting, SettingError, read_setting
from rabbit_reproduce.table_lines import COLUMNS, MAIN, QUICK, RIGID, SEED, Line
from rabbit_reproduce.training import SHIPPED, Trained
from rabbit_reproduce.training_jobs import TrainingJob
from typer.testing import CliRunner

FAST = Setting(plant="rigid", controller={"gait": "stones_0350_084", "eps": 0.06}, training={"sigma": 4.0})
SIZE = replace(QUICK, setting=FAST)


def test_it_counts_where_an_experiment_has_no_value_of_its_own() -> None:
    own = SIZE.own(CBF_CLF.assembly({"eps": 0.1}, mass_scale=2.0))
    assert (own.controller.eps, own.controller.gait, own.simulation.plant) == (0.1, "stones_0350_084", "rigid")
    assert own.simulation.mass_scale == 2.0
    usual = CBF_CLF.assembly(mass_scale=2.0)
    assert QUICK.own(usual) == usual


def test_another_plant_is_no_column_twice() -> None:
    assert [each.plant for each in SIZE.columns(COLUMNS)] == ["pybullet"] * 2  # which stands for rigid
    assert QUICK.columns(COLUMNS) == list(COLUMNS)
    assert replace(QUICK, beside=0).columns(COLUMNS) == [MAIN]
    assert (SIZE.title(MAIN), QUICK.title(MAIN), QUICK.title(RIGID)) == ("rigid", "PyBullet", "rigid")
    line = Line("", CBF_CLF.assembly())
    assert line.scenario(SIZE).assembly.simulation.plant == "rigid"
    assert line.scenario(SIZE).seed == SEED


def test_trainings_are_of_the_setting_and_stand_in_for_the_shipped_policies(tmp_path: Path) -> None:
    made = SHIPPED["rl-cbf-clf-qp"]
    trained = Trained(tmp_path, (made,), FAST)
    (job,) = trained.jobs
    assert (job.controller.gait, job.controller.eps, job.plant.plant) == ("stones_0350_084", 0.06, "rigid")
    assert (job.parameters.sigma, job.parameters.seed) == (4.0, made.parameters.seed)
    assert job.folder != replace(made, root=tmp_path).folder
    assert "--gait stones_0350_084" in job.command
    assert "--plant rigid" in job.command
    assert made.command == TrainingJob(made.parameters).command
    size = replace(SIZE, trained=trained)
    assert size.own(RL_CBF_CLF.assembly()).policy == str(trained.policy(made))
    assert size.own(RL_CLF.assembly()).policy == RL_CLF.assembly().policy


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("controller: {epsilon: 1}", "epsilon"),
        ("controller: {eps: -1}", "eps"),
        ("controller: {controller: clf-qp}", "controller: each experiment has its own"),
        ("training: {seed: 3}", "seed: each training has its own"),
        ("training: {sigma: -3}", "sigma"),
        ("plant: moon", "moon"),
        ("eps: 1", "eps"),
        ("[", "setting.yaml"),
    ],
)
def test_what_is_no_setting_is_refused(text: str, words: str, tmp_path: Path) -> None:
    path = tmp_path / "setting.yaml"
    path.write_text(text)
    with pytest.raises(SettingError, match=words):
        read_setting(path)
    refused = CliRunner().invoke(app, ["stepping-stone", "--setting", str(path), "--out", str(tmp_path / "out")])
    assert refused.exit_code == 2
    assert words in " ".join(refused.stderr.split())
    assert not (tmp_path / "out").exists()


def test_a_shipped_setting_has_a_name_and_lies_in_the_box() -> None:
    paths = list(SETTINGS.glob("*.yaml"))
    assert SETTINGS / "most_claims.yaml" in paths
    for path in paths:
        assert read_setting(path.stem) == read_setting(path)
    with pytest.raises(SettingError, match=r"no_such\.yaml"):
        read_setting("no_such")


def test_an_experiment_in_a_setting(tmp_path: Path) -> None:
    path = tmp_path / "setting.yaml"
    path.write_text("plant: rigid\ncontroller: {gait: stones_0350_084}\n")
    words = ["stepping-stone", "--setting", str(path), "--quick", "--jobs", "1", "--out", str(tmp_path / "out")]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    page = (tmp_path / "out" / "results.md").read_text()
    assert '{"plant": "rigid", "controller": {"gait": "stones_0350_084"}}' in page
    assert "--plant rigid --mass-scale 2 --gait stones_0350_084" in page
    assert "| PyBullet" not in page
