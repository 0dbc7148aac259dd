"""`rabbit reproduce`: a tiny experiment to its files, the commands of its rows, the same courses for all."""

import shlex
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from matplotlib.figure import Figure
from rabbit_experiments.commands import evaluate as evaluate_module
from rabbit_reproduce.catalogue import EXPERIMENTS
from rabbit_reproduce.catalogue.higher_gain import ENGINES, WHO, HigherGain
from rabbit_reproduce.command_lines import evaluate_command
from rabbit_reproduce.controllers import CBF_CLF, CBF_CLF_ORACLE
from rabbit_reproduce.curves import tracking_figure
from rabbit_reproduce.experiment import Experiment
from rabbit_reproduce.page import make
from rabbit_reproduce.report import RUNS, Claim, judge, read_rows
from rabbit_reproduce.table_lines import COLUMNS, FULL, QUICK, Line, Results, Size
from typer.testing import CliRunner

LINES = [line for experiment in EXPERIMENTS for line in experiment.lines()]


class OneStone(Experiment):
    """Nominal and oracle."""

    name = "one-stone"
    title = "One stone"
    label = "fig:none"
    paper = "Nothing."
    shown = ("nominal",)

    def __init__(self) -> None:
        assembly, oracle = (contender.assembly(stones=1) for contender in (CBF_CLF, CBF_CLF_ORACLE))
        self.by_key = {"nominal": Line("nominal", assembly, "walks"), "oracle": Line("oracle", oracle)}

    def claims(self, results: Results) -> list[Claim]:
        """It walks."""
        walks = results.walks(self.by_key["nominal"])
        return [
            Claim(
                claim="it walks", paper="walks", ours=walks.text, verdict=judge({"walks": walks.walked == walks.runs})
            )
        ]

    def figures(self, results: Results) -> dict[str, Figure]:
        """One."""
        return {"errors": tracking_figure({CBF_CLF: results.records(self.by_key["nominal"])})}


def test_a_tiny_experiment_to_its_files(tmp_path: Path) -> None:
    experiment, tiny = OneStone(), Size(quick=True, runs=2, beside=1)
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


@pytest.mark.parametrize("line", LINES[:: max(1, len(LINES) // 12)], ids=lambda line: line.what)
def test_a_rows_command_makes_its_runs(line: Line, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`rabbit evaluate`, told the command, has the same plant, controller, policy, seed and number of runs."""
    scenario = line.scenario(QUICK)
    seen: dict[str, Any] = {}
    monkeypatch.setattr(evaluate_module, "walk_all", lambda scenario, *_: (seen.update(scenario=scenario), 0))
    monkeypatch.setattr(evaluate_module, "conclude", lambda *_: {})
    monkeypatch.setattr(evaluate_module, "show", lambda *_: None)
    words = shlex.split(evaluate_command(scenario).replace("--out DIR", f"--out {tmp_path}"))
    assert CliRunner().invoke(evaluate_module.app, words[2:]).exit_code == 0
    assert replace(seen["scenario"], title=line.what) == scenario


def test_at_each_point_every_controller_walks_the_same_courses_in_both_engines() -> None:
    lines = HigherGain().by_key
    for _, field, value in lines:
        for engine in ENGINES:
            scenarios = [lines[who, field, value].scenario(FULL, engine) for who in WHO]
            assert len({(scenario.seed, scenario.runs, scenario.assembly.simulation) for scenario in scenarios}) == 1
            assert scenarios[0].runs >= 20
            assert scenarios[0].assembly.simulation.plant == engine.plant
            assert getattr(scenarios[0].assembly.simulation, field) == value
