"""What is wrong with a person's task is one line: the file, the line, its text. Higher relative degrees ride."""

from pathlib import Path

import pytest
from own_cart import CART
from rabbit_bringup.cli import app
from rabbit_description.task import TaskError
from rabbit_description.task_source import load_task
from rl_cbf_clf_controller.task_controller import TaskController
from rl_trainer.task_episode import ride_of
from rl_trainer.task_training import train
from typer.testing import CliRunner

BALL = Path(__file__).resolve().parents[2] / "examples" / "ball_on_beam.py"


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"mass": 1.0', '"mass": 1 / 0', 'line 9: ZeroDivisionError: division by zero: `nominal={"mass": 1 / 0}'),
        ("import casadi as ca", "import nosuch as ca", "line 2: ModuleNotFoundError: No module named 'nosuch'"),
        ("limit=20.0", "limt=20.0", "line 6: TypeError: "),
        ("commands=lambda rng: lambda t: {", "commands=lambda rng: lambda t: 1 / 0 or {", "line 10: ZeroDivisionError"),
        ("poles=(4.0, 4.0)", "poles=(4.0, 4.0, 4.0)", ": wall: relative degree 2, but 3 was given"),
        ("Clf(x - target)", "Clf(x - target, gains=(-1.0, 1.0))", ": gains = [-1.0, 1.0] do not stabilise"),
    ],
)
def test_an_error_in_a_task_names_file_and_line(tmp_path: Path, old: str, new: str, said: str) -> None:
    path = tmp_path / "cart.py"
    assert old in CART
    path.write_text(CART.replace(old, new))
    with pytest.raises(TaskError) as error:
        load_task(str(path))
    assert str(path) in str(error.value)
    assert said in str(error.value)
    assert "\n" not in str(error.value)
    result = CliRunner().invoke(app, ["evaluate", "--task", str(path), "--rides", "1"])
    assert result.exit_code == 2
    assert result.output.count("\n") == 1
    assert said.rstrip("`") in result.output


def test_a_barrier_of_degree_4_is_kept_by_the_oracle_and_nothing_is_learned_of_it() -> None:
    """A ball on a beam: the oracle meets the row of the true ball, the nominal controller that of its model."""
    task = load_task(str(BALL))
    controller = TaskController(task)
    nominal, oracle = (ride_of(controller, name, 1) for name in ("nominal", "oracle"))
    assert (nominal.outcome, oracle.outcome) == ("done", "done")
    assert nominal.margins[0] < -0.05
    assert 0 <= oracle.margins[0] < 0.005  # it comes near
    with pytest.raises(ValueError, match="one difference measures relative degrees 1 and 2 only"):
        train(task, 1)


def test_task_is_an_option_of_what_evaluates_rabbit_too(tmp_path: Path) -> None:
    words = ["--runs", "1", "--seed", "3", "--out"]
    ways = {"option": ["evaluate", *words, str(tmp_path / "option"), "--task", str(BALL)]}
    ways["equals"] = ["evaluate", f"--task={BALL}", *words, str(tmp_path / "equals")]
    for way in ways.values():
        result = CliRunner().invoke(app, way)
        assert result.exit_code == 0, result.output
    tables = {(tmp_path / name / "runs.csv").read_text() for name in ways}
    assert len(tables) == 1
    missing = CliRunner().invoke(app, ["evaluate", "--task"])
    assert (missing.exit_code, "--task" in missing.output) == (2, True)
