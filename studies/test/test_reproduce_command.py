"""`rabbit reproduce`: a tiny experiment to its files, the commands of its rows, and what is wrong in one line."""

import shlex
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rabbit_experiments.cache import Cache
from rabbit_experiments.commands import evaluate as evaluate_module
from rabbit_reproduce import catalogue
from rabbit_reproduce.catalogue import EXPERIMENTS
from rabbit_reproduce.command_lines import evaluate_command
from rabbit_reproduce.commands.reproduce import app
from rabbit_reproduce.experiment import Experiment
from rabbit_reproduce.page import PAGE, make
from rabbit_reproduce.report import CLAIMS, RUNS, Table, read_rows
from rabbit_reproduce.table_lines import COLUMNS, FULL, QUICK, Found, Line, Size
from typer.testing import CliRunner, Result

Maker = Callable[..., Experiment]
LINES = [line for each in EXPERIMENTS for line in each.lines()]


def rabbit(*words: object) -> Result:
    """Call the command in this process."""
    return CliRunner().invoke(app, [str(word) for word in words])


def test_a_tiny_experiment_to_its_files(tmp_path: Path, one_stone: Maker, tiny: Size) -> None:
    experiment = one_stone()
    page, done = make([experiment], tiny, tmp_path, ["one-stone"])
    at_its_best = 2 + 1  # on the plants that claims are judged on
    assert done == len(experiment.jobs(tiny)) == 2 * (2 + 3) + 1 + at_its_best
    assert (tmp_path / "one-stone" / "errors.png").stat().st_size > 0
    rows = read_rows(tmp_path / RUNS)
    assert {row["experiment"] for row in rows} == {"one-stone"}
    assert "--seed 50001" in rows[0]["command"]
    assert [(row["plant"], row["motor_lag"]) for row in rows[:4]] == [(c.plant, str(c.lag)) for c in COLUMNS]
    assert {row["runs"] for row in rows} == {"2", "1"}
    text = page.read_text()
    for part in ("fig:none", "**reproduced**", "one-stone/errors.png", "rabbit reproduce one-stone --quick", "2 of 2"):
        assert part in text
    assert make([experiment], tiny, tmp_path, ["one-stone"])[1] == 0


def test_the_page_keeps_what_was_made_before(tmp_path: Path, one_stone: Maker, tiny: Size) -> None:
    make([one_stone()], tiny, tmp_path, ["one-stone", "again"])
    page, done = make([one_stone("again")], tiny, tmp_path, ["one-stone", "again"])
    assert done == 0
    assert "**one-stone**" in page.read_text()
    assert "**again**" in page.read_text()
    assert [row["experiment"] for row in read_rows(tmp_path / CLAIMS)] == ["again", "one-stone"]


def test_what_was_stopped_leaves_what_is_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, one_stone: Maker, tiny: Size
) -> None:
    whole, other = one_stone(), one_stone("other", 1.1)
    make([whole], tiny, tmp_path, ["one-stone", "other"])
    (tmp_path / PAGE).unlink()

    def stopped(*_: Any, **__: Any) -> int:
        raise KeyboardInterrupt

    monkeypatch.setattr("rabbit_reproduce.page.run", stopped)
    with pytest.raises(KeyboardInterrupt):
        make([whole, other], tiny, tmp_path, ["one-stone", "other"])
    assert "**one-stone**" in (tmp_path / PAGE).read_text()
    assert "other" not in {row["experiment"] for row in read_rows(tmp_path / CLAIMS)}


def test_the_command(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, one_stone: Maker, tiny: Size) -> None:
    monkeypatch.setattr(catalogue, "EXPERIMENTS", (one_stone(),))
    monkeypatch.setattr("rabbit_reproduce.table_lines.QUICK", tiny)
    done = rabbit("one-stone", "--quick", "--out", tmp_path, "--jobs", 1)
    assert done.exit_code == 0, done.output
    assert (tmp_path / PAGE).is_file()
    assert "0 runs made" in rabbit("--quick", "--out", tmp_path, "--jobs", 1).output


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (("nobody",), ("nobody: expected one of", "clf-results")),
        (("--jobs", 0), ("--jobs",)),
    ],
)
def test_what_is_wrong_ends_with_exit_code_2(words: tuple[object, ...], told: tuple[str, ...]) -> None:
    done = rabbit(*words)
    assert done.exit_code == 2
    for text in told:
        assert text in done.stderr


def test_list_names_every_experiment_once() -> None:
    lines = rabbit("--list").output.splitlines()
    names = [line.split()[0] for line in lines]
    assert names == [each.name for each in EXPERIMENTS]
    assert len(set(names)) == len(names)


@pytest.mark.parametrize("line", LINES[:: max(1, len(LINES) // 12)], ids=lambda line: line.what)
def test_a_rows_command_makes_its_runs(line: Line, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`rabbit evaluate`, told the command, has the same plant, controller, policy, seed and number of runs."""
    scenario = line.scenario(QUICK)
    seen: dict[str, Any] = {}
    monkeypatch.setattr(evaluate_module, "walk_all", lambda scenario, *_: (seen.update(scenario=scenario), 0))
    monkeypatch.setattr(evaluate_module, "conclude", lambda *_: {})
    monkeypatch.setattr(evaluate_module, "show", lambda *_: None)
    words = shlex.split(evaluate_command(scenario).replace("--out DIR", f"--out {tmp_path}"))
    monkeypatch.setattr("rabbit_experiments.results.ResultsFolder", lambda *_: None)
    assert CliRunner().invoke(evaluate_module.app, words[2:]).exit_code == 0
    assert replace(seen["scenario"], title=line.what) == scenario


@pytest.mark.parametrize("size", [FULL, QUICK], ids=["full", "quick"])
@pytest.mark.parametrize("experiment", EXPERIMENTS, ids=lambda each: each.name)
def test_every_experiment_names_its_runs(experiment: Any, size: Size) -> None:
    assert experiment.jobs(size) or not experiment.lines()
    assert len({line.what for line in experiment.lines()}) == len(experiment.lines())
    assert experiment.title
    assert experiment.paper.endswith(".")


def test_a_missing_run_is_told(tmp_path: Path, one_stone: Maker, tiny: Size) -> None:
    with pytest.raises(LookupError, match="nominal, seed"):
        Found(Cache(tmp_path), tiny).walks(one_stone().lines()[0])


def test_a_table_has_bare_values() -> None:
    assert Table("t", ("a", "b"), ((1.23456, "x|y"), (None, 2))).csv.splitlines() == ["a,b", "1.23456,x|y", ",2"]
