"""Variants that build and differ, a study that goes on where it stopped, and a table with known figures."""

import csv
from pathlib import Path
from typing import Any

import pytest
import typer
from rabbit_experiments.cache import JobError
from rabbit_experiments.evaluation import Walk
from rabbit_experiments.metrics import RunResult, RunRow
from rabbit_reproduce import ablations
from rabbit_reproduce.ablations import NEWEST, VARIANTS, Row, Study, markdown
from rabbit_reproduce.training_jobs import TrainingJob, TrainingReport
from rl_trainer.parameters import TrainingParameters
from typer.testing import CliRunner, Result

EPISODE = {"kept": 5, "seconds": 1.0, "reward": dict.fromkeys(("V", "B1", "B2", "C1", "C2"), -1.0)}


def row(variant: str, seed: int, **changes: Any) -> Row:
    """A row in which nothing happened, but for `changes`."""
    values: dict[str, Any] = dict.fromkeys(Row.model_fields, 0)
    return Row.model_validate(values | {"variant": variant, "training_seed": seed, "falls": "", "runs": 20} | changes)


def run(*words: object) -> Result:
    """Call the command in this process."""
    app = typer.Typer()
    app.command()(ablations.main)
    return CliRunner().invoke(app, [str(word) for word in words])


def table(out: Path) -> list[dict[str, str]]:
    """The rows of a study."""
    with (out / "ablations.csv").open(newline="") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def trained(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Trainings asked for, in place of trainings; no walk is walked."""
    asked: list[str] = []

    def instead(recipe: TrainingJob) -> TrainingReport:
        asked.append(recipe.title)
        if recipe.title.startswith("regression"):
            raise JobError(f"{recipe.title}: no such state")
        return TrainingReport(commit="", transitions=5, episodes=[EPISODE])

    def no_walk(job: Walk) -> RunResult:
        values = dict.fromkeys(RunRow.model_fields, 0) | {"outcome": "walked", "success": True, "stones": 20}
        values |= {"least_barriers": {}}
        return RunResult(row=RunRow.model_validate(values), violations=[], tick_seconds=[])

    monkeypatch.setattr(TrainingJob, "do", instead)
    monkeypatch.setattr(Walk, "do", no_walk)
    return asked


@pytest.mark.parametrize("name", VARIANTS)
def test_a_variant_changes_what_it_says(name: str) -> None:
    variant = VARIANTS[name]
    parameters = variant.parameters(seed=7)
    assert parameters.seed == 7
    assert {key: getattr(parameters, key) for key in variant.changes} == variant.changes
    assert variant.parameters(seed=7, episodes=4).episodes == 4
    if name != "default":
        other = VARIANTS[variant.against]
        stops = (other.transitions, other.literal, other.learner) != (
            variant.transitions,
            variant.literal,
            variant.learner,
        )
        assert stops or parameters != other.parameters(seed=7)


def test_the_default_is_what_is_trained_without_a_word() -> None:
    assert VARIANTS["default"].parameters(seed=1) == TrainingParameters()


def test_what_is_done_is_not_done_again(tmp_path: Path, trained: list[str]) -> None:
    first = ("default", "no-l-min", "--out", tmp_path, "--seeds", 1, "--runs", 3)
    assert run(*first).exit_code == 0
    assert trained == ["default, seed 1", "no-l-min, seed 1"]
    assert run("no-l-min", "absolute-error", "--out", tmp_path, "--seeds", 1, "--seeds", 2, "--runs", 4).exit_code == 0
    assert trained[2:] == ["absolute-error, seed 1", "no-l-min, seed 2", "absolute-error, seed 2"]
    rows = [(row["variant"], row["training_seed"], row["runs"]) for row in table(tmp_path)]
    assert rows == [
        ("absolute-error", "1", "4"),
        ("absolute-error", "2", "4"),
        ("no-l-min", "1", "4"),
        ("no-l-min", "2", "4"),
    ]


def test_a_training_that_fails_leaves_the_others(tmp_path: Path, trained: list[str]) -> None:
    done = run("regression", "default", "--out", tmp_path, "--seeds", 1)
    assert done.exit_code == 1
    assert "regression, seed 1: no such state" in done.output
    assert [(row["variant"], row["walked"]) for row in table(tmp_path)] == [("default", "20")]


def test_what_was_stopped_leaves_the_rows_that_are_whole(
    tmp_path: Path, trained: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert run("default", "--out", tmp_path, "--seeds", 1).exit_code == 0

    def stop(_: TrainingJob) -> TrainingReport:
        raise KeyboardInterrupt

    monkeypatch.setattr(TrainingJob, "do", stop)
    assert run("default", "no-l-min", "--out", tmp_path, "--seeds", 1).exit_code == 130
    assert [row["variant"] for row in table(tmp_path)] == ["default"]


def test_a_short_study_leaves_sessions_and_a_row(tmp_path: Path) -> None:
    words = ("paper-literal", "--out", tmp_path, "--seeds", 2, "--runs", 1)
    done = run(*words, "--episodes", 1)
    assert done.exit_code == 0, done.output
    (first,) = table(tmp_path)
    assert [first[name] for name in ("variant", "training_seed", "runs", "episodes")] == [
        "paper-literal",
        "2",
        "1",
        "1",
    ]
    recipe = Study(tmp_path, episodes=1).recipe("paper-literal", 2)
    (episode,) = recipe.do().episodes  # which go on from the folder
    assert int(first["transitions"]) == episode["kept"]
    assert float(first["reward_V"]) == episode["reward"]["V"]


def test_transitions_end_a_training(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    variant = ablations.Variant("one transition is enough", transitions=1, literal=True)
    monkeypatch.setitem(VARIANTS, "short", variant)
    assert variant.parameters(seed=1).episodes == ablations.MOST_EPISODES
    assert len(Study(tmp_path, runs=1).recipe("short", 1).do().episodes) == 1


def test_figures_of_the_table() -> None:
    rows = [
        row("default", 1, walked=20, mean_stones=20.0, transitions=6500),
        row("default", 2, walked=10, mean_stones=15.0, transitions=6000),
        row("paper-literal-long", 1, walked=0, mean_stones=1.0, transitions=70),
    ]
    head, _, default, longer = [line.split(" | ") for line in markdown(rows).splitlines()]
    assert len(head) == len(default) == len(longer)
    walked, (low, high) = default[3].split(", ")[0], map(float, default[3].split(", ")[1].split(" to "))
    assert walked == "30 of 40"
    for end in (low, high):  # Wilson's ends solve (share - end)^2 = z^2 end (1 - end) / n
        assert (0.75 - end) ** 2 == pytest.approx(1.96**2 * end * (1 - end) / 40, abs=2e-3)
    assert default[4:] == ["20 / 10", "17.5", "6500 / 6000 |"]
    assert longer[:5] == [
        "| `paper-literal-long`",
        VARIANTS["paper-literal-long"].meaning,
        "`paper-literal`",
        "0 of 20, 0.00 to 0.16",
        "0",
    ]


def test_reward_terms_count_by_transition() -> None:
    episodes = [
        {"kept": 3, "reward": {"V": -1.0}},
        {"kept": 1, "reward": {"V": -5.0}},
        *[{"kept": 0, "reward": {"V": -9.0}}] * (NEWEST - 2),
    ]
    report = TrainingReport(commit="", transitions=4, episodes=[{"kept": 9, "reward": {"V": -7.0}}, *episodes])
    assert ablations.mean_reward(report, "V") == -2.0


def test_an_unknown_variant_ends_in_one_line(tmp_path: Path) -> None:
    refused = run("default", "nonsense", "--out", tmp_path / "study")
    assert (refused.exit_code, refused.stderr.count("\n")) == (2, 1)
    assert "nonsense" in refused.stderr
    assert not (tmp_path / "study").exists()


def test_the_list_names_every_variant() -> None:
    lines = run("--list").output.splitlines()
    assert [line.split()[0] for line in lines] == list(VARIANTS)
