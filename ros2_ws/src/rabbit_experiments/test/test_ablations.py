"""Variants that build and differ, a study that goes on where it stopped, and a table with known figures."""

import json
from pathlib import Path
from typing import Any

import pytest
import typer
from rabbit_experiments import ablations
from rabbit_experiments.ablations import NEWEST, VARIANTS, Row, Rows, Study, StudyError, markdown
from rl_trainer.parameters import TrainingParameters
from typer.testing import CliRunner, Result


def row(variant: str, seed: int, **changes: Any) -> Row:
    """A row in which nothing happened, but for `changes`."""
    values: dict[str, Any] = dict.fromkeys(Row.model_fields, 0)
    return Row.model_validate(values | {"variant": variant, "training_seed": seed, "falls": "", "runs": 20} | changes)


def run(*words: object) -> Result:
    """Call the command in this process."""
    app = typer.Typer()
    app.command()(ablations.main)
    return CliRunner().invoke(app, [str(word) for word in words])


@pytest.fixture
def trained(monkeypatch: pytest.MonkeyPatch) -> list[tuple[str, int]]:
    """Trainings asked for, in place of trainings."""
    asked: list[tuple[str, int]] = []

    def instead(study: Study, name: str, seed: int) -> Row:
        asked.append((name, seed))
        return row(name, seed, runs=study.runs)

    monkeypatch.setattr(Study, "row", instead)
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
        stops = (other.transitions, other.literal) != (variant.transitions, variant.literal)
        assert stops or parameters != other.parameters(seed=7)


def test_the_default_is_what_is_trained_without_a_word() -> None:
    assert VARIANTS["default"].parameters(seed=1) == TrainingParameters()


def test_rows_that_are_done_are_not_done_again(tmp_path: Path, trained: list[tuple[str, int]]) -> None:
    first = ("default", "no-l-min", "--out", tmp_path, "--seeds", 1, "--runs", 3)
    assert run(*first).exit_code == 0
    assert trained == [("default", 1), ("no-l-min", 1)]
    assert run("no-l-min", "penalty", "--out", tmp_path, "--seeds", 1, "--seeds", 2, "--runs", 3).exit_code == 0
    assert trained[2:] == [("penalty", 1), ("no-l-min", 2), ("penalty", 2)]
    lines = (tmp_path / "ablations.csv").read_text().splitlines()
    assert [line.split(",")[:2] for line in lines[1:]] == [
        ["default", "1"],
        ["penalty", "1"],
        ["penalty", "2"],
        ["no-l-min", "1"],
        ["no-l-min", "2"],
    ]


def test_a_folder_of_another_study_is_refused(tmp_path: Path, trained: list[tuple[str, int]]) -> None:
    assert run("default", "--out", tmp_path, "--seeds", 1, "--runs", 3).exit_code == 0
    refused = run("default", "--out", tmp_path, "--seeds", 1, "--runs", 4)
    assert (refused.exit_code, refused.stderr.count("\n")) == (2, 1)
    assert "another study" in refused.stderr
    assert len(trained) == 1
    Rows(Study(tmp_path, runs=3))
    (tmp_path / "ablations.csv").write_text("variant,runs\ndefault,x\n")
    with pytest.raises(StudyError, match="cannot be read"):
        Rows(Study(tmp_path, runs=3))


def test_a_training_that_fails_leaves_the_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def instead(study: Study, name: str, seed: int) -> Row:
        if name == "default":
            raise ablations.ControllerError("no such state")
        return row(name, seed)

    monkeypatch.setattr(Study, "row", instead)
    done = run("default", "penalty", "--out", tmp_path, "--seeds", 1)
    assert done.exit_code == 1
    assert "default, seed 1: no row: no such state" in done.output
    assert Rows(Study(tmp_path)).done.keys() == {("penalty", 1)}


def test_a_short_study_leaves_sessions_and_a_row(tmp_path: Path) -> None:
    words = ("paper-literal", "--out", tmp_path, "--seeds", 2, "--runs", 1)
    done = run(*words, "--episodes", 1)
    assert done.exit_code == 0, done.output
    ((key, first),) = Rows(Study(tmp_path, runs=1, episodes=1)).done.items()
    assert (*key, first.runs, first.episodes) == ("paper-literal", 2, 1, 1)
    (episode,) = map(json.loads, (tmp_path / "paper-literal" / "2" / "episodes.jsonl").read_text().splitlines())
    assert first.transitions == episode["kept"]
    assert first.reward_V == episode["reward"]["V"]


def test_transitions_end_a_training(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    variant = ablations.Variant("one transition is enough", transitions=1, literal=True)
    monkeypatch.setitem(VARIANTS, "short", variant)
    assert variant.parameters(seed=1).episodes == ablations.MOST_EPISODES
    assert Study(tmp_path, runs=1).row("short", 1).episodes == 1


def test_figures_of_the_table() -> None:
    rows = [
        row("default", 1, walked=20, mean_stones=20.0, transitions=6500),
        row("default", 2, walked=10, mean_stones=15.0, transitions=6000),
        row("one-head", 1, walked=0, mean_stones=1.0, transitions=70),
    ]
    head, _, default, one_head = [line.split(" | ") for line in markdown(rows).splitlines()]
    assert len(head) == len(default) == len(one_head)
    walked, (low, high) = default[3].split(", ")[0], map(float, default[3].split(", ")[1].split(" to "))
    assert walked == "30 of 40"
    for end in (low, high):  # Wilson's ends solve (share - end)^2 = z^2 end (1 - end) / n
        assert (0.75 - end) ** 2 == pytest.approx(1.96**2 * end * (1 - end) / 40, abs=2e-3)
    assert default[4:] == ["20 / 10", "17.5", "6500 / 6000 |"]
    assert one_head[:5] == ["| `one-head`", VARIANTS["one-head"].meaning, "`no-relabel`", "0 of 20, 0.00 to 0.16", "0"]


def test_reward_terms_count_by_transition() -> None:
    episodes = [
        {"kept": 3, "reward": {"V": -1.0}},
        {"kept": 1, "reward": {"V": -5.0}},
        {"kept": 0, "reward": {"V": -9.0}},
    ]
    assert ablations.mean_reward(episodes[-NEWEST:], "V") == -2.0


def test_an_unknown_variant_ends_in_one_line(tmp_path: Path) -> None:
    refused = run("default", "nonsense", "--out", tmp_path / "study")
    assert (refused.exit_code, refused.stderr.count("\n")) == (2, 1)
    assert "nonsense" in refused.stderr
    assert not (tmp_path / "study").exists()


def test_the_list_names_every_variant() -> None:
    lines = run("--list").output.splitlines()
    assert [line.split()[0] for line in lines] == list(VARIANTS)
