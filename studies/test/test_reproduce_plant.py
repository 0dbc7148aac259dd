"""Another plant in place of PyBullet: of walks, of trainings, on the page."""

from dataclasses import replace
from pathlib import Path

from rabbit_reproduce.commands.reproduce import app
from rabbit_reproduce.controllers import CBF_CLF, RL_CBF_CLF, RL_CLF
from rabbit_reproduce.table_lines import QUICK
from rabbit_reproduce.training import SHIPPED, training_job, under
from typer.testing import CliRunner

SIZE = replace(QUICK, plant="rigid")


def test_it_takes_the_place_of_pybullet_alone() -> None:
    usual = CBF_CLF.assembly(mass_scale=2.0)
    own = SIZE.own(usual)
    assert own == replace(usual, simulation=usual.simulation.model_copy(update={"plant": "rigid"}))
    mujoco = CBF_CLF.assembly(plant="mujoco")
    assert SIZE.own(mujoco) is mujoco
    assert QUICK.own(usual) is usual


def test_trainings_are_on_it_and_stand_in_for_the_shipped_policies(tmp_path: Path) -> None:
    made = SHIPPED["rl-cbf-clf-qp"]
    trained = under(tmp_path, [made], "rigid")
    (job,) = trained.made.values()
    assert (job.plant.plant, job.parameters, job.controller) == ("rigid", made.parameters, made.controller)
    assert job.folder != replace(made, root=tmp_path).folder
    assert job.command == made.command.replace("--mass-scale", "--plant rigid --mass-scale")
    assert "--gait wide" in training_job(made.parameters, gait="wide").command
    size = replace(SIZE, trained=trained)
    assert size.own(RL_CBF_CLF.assembly()).policy == str(trained.policy(made))
    assert size.own(RL_CLF.assembly()).policy == RL_CLF.assembly().policy


def test_an_experiment_on_another_plant(tmp_path: Path) -> None:
    words = ["stepping-stone", "--plant", "rigid", "--quick", "--jobs", "1", "--out", str(tmp_path)]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    page = (tmp_path / "results.md").read_text()
    assert "Judged on `rigid`." in page
    assert "`rabbit reproduce stepping-stone --quick --plant rigid` makes this section" in page
    assert "--plant rigid --mass-scale 2" in page
    assert "| PyBullet" not in page
