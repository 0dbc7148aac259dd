"""The benchmark: its statistics, its cells and storm, methods of someone else, and a run that goes on."""

import csv
from pathlib import Path

import pytest
from rabbit_benchmark.cells import cells, chosen, storm, storm_plant
from rabbit_benchmark.commands.benchmark import app
from rabbit_benchmark.comparison import holm, paired
from rabbit_benchmark.families import families
from rabbit_benchmark.methods import BUILT_IN
from rabbit_benchmark.protocol import SEEDS, Protocol, plan
from rabbit_benchmark.report import Benchmark
from rabbit_experiments.cache import Cache
from rabbit_experiments.engine import run
from rabbit_sim.parameters import SimulationParameters
from typer.testing import CliRunner

TINY = Protocol(courses=1, stones=1)


def test_paired_courses_have_a_binomial_sign_test_and_a_difference_with_an_interval() -> None:
    """The test is over the discordant ones.

    20 against 10 of 100: with half a course more in each cell 10 of 102, and the variance 31 - 10^2 / 102.
    """
    five = paired([True] * 5 + [True, False], [False] * 5 + [True, False])
    assert (five.courses, five.only_this, five.only_other) == (7, 5, 0)
    assert five.p_value == pytest.approx(2 * 0.5**5)
    assert paired([True, False], [True, False]).p_value == 1
    assert paired([True, False], [False, True]).p_value == 1
    pair = paired([True] * 20 + [False] * 80, [False] * 20 + [True] * 10 + [False] * 70)
    assert pair.difference == pytest.approx((0.1, 0.09804 - 0.10528, 0.09804 + 0.10528), abs=1e-5)
    least, low, high = paired([False] * 10, [True] * 10).difference
    assert (least, low) == (-1, -1)
    assert -1 < high < 0


def test_holm_multiplies_the_least_by_all_and_never_decreases() -> None:
    assert holm([0.01, 0.04, 0.03]) == pytest.approx([0.03, 0.06, 0.06])
    assert holm([0.9, 0.8]) == [1, 1]
    assert holm([]) == []


def test_the_storm_is_drawn_by_its_seed_within_its_ranges() -> None:
    for terrain in ("stones", "flat"):
        drawn = [storm_plant(number, SEEDS["reported"], terrain) for number in range(100)]
        assert drawn == [storm_plant(number, SEEDS["reported"], terrain) for number in range(100)]
        assert drawn != [storm_plant(number, SEEDS["development"], terrain) for number in range(100)]
        for plant in drawn:
            SimulationParameters(**plant)
            for name, value in plant.items() - storm().choices.items():
                low, high = storm().on(terrain)[name]
                assert low <= value <= high
    assert "stone_height" not in storm().on("flat")
    assert cells()["flat/storm"].courses(10) == 100


def test_the_second_storm_has_no_family_that_came_after_it() -> None:
    known = {"terrain", "sensors", *storm().on("stones")}
    for family in families().families.values():
        if family.split in ("development", "reported"):
            known |= {**(family.stones or {}), **(family.flat or {})}.keys()
    for cell in chosen(["storm-2"]):
        seen = {name for number in range(200) for name in cell.plant(number, SEEDS["reported"])}
        assert seen <= known


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["best:eps=7"], "best:eps=7: controller parameters"),
        (["nominal:eps="], "expected PARAMETER=VALUE"),
        (["l1"], "l1: no controller for stones"),
        (["best", "--against", "nobody"], "--against nobody"),
    ],
)
def test_what_nobody_could_walk_is_refused(words: list[str], said: str, tmp_path: Path) -> None:
    refused = CliRunner().invoke(app, [*words, "--cells", "stones/scale-2", "--out", str(tmp_path / "out")])
    assert (refused.exit_code, said in refused.stderr) == (2, True), refused.stderr
    assert not (tmp_path / "out").exists()


def test_a_method_that_is_named_twice_walks_once() -> None:
    words = ["nominal:eps=0.03,0.030", "nominal:eps=0.02,0.03", "--cells", "stones/scale-2", "--list"]
    methods = CliRunner().invoke(app, words).stdout.splitlines()[:-1]
    assert [line.split()[0] for line in methods] == ["nominal:eps=0.03", "nominal:eps=0.02"]


def test_a_benchmark_goes_on_and_leaves_a_blank_with_its_reason(tmp_path: Path) -> None:
    entered = [method for method in BUILT_IN if method.name in ("nominal-pd", "robust", "identified")]
    wanted, cache = chosen(["flat/scale-1"]), Cache(tmp_path / "cache")
    runs = plan(TINY, entered, wanted)
    jobs = [job for walks in runs.values() if not isinstance(walks, str) for job in walks]
    assert run(jobs[:1], cache) == 1
    assert run(jobs, cache) == 1
    page = Benchmark(TINY, entered, wanted, runs, cache).write(tmp_path)
    rows = {row["method"]: row for row in csv.DictReader((tmp_path / "benchmark.csv").open())}
    assert rows["robust"]["reason"] == "no controller for flat"
    assert rows["robust"]["walked"] == ""
    assert rows["identified"]["courses"] == "1"
    assert "robust is blank where it has no controller for flat" in page.read_text()
    assert (tmp_path / "cells.png").stat().st_size > 0
