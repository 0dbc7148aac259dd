"""What README.md says of courses at half, twice and thrice the mass follows from the courses, packed in docs/data."""

import csv
import gzip
from functools import cache
from pathlib import Path

import pytest
from rabbit_benchmark.comparison import of_so_many
from rabbit_experiments.conditions import WalkOptions
from rabbit_experiments.evaluation import episode_seeds, walk
from rabbit_reproduce.controllers import AT_ITS_BEST, BEST, Contender

ROOT = Path(__file__).parents[2]
COURSES, SEED = 200, WalkOptions.model_fields["seed"].default
ENGINES, SCALES = ("pybullet", "mujoco"), ("0.5", "2", "3")
WHO: dict[str, Contender] = {"best": BEST["stones"], "nominal_tuned": AT_ITS_BEST["stones"]}


@cache
def rows() -> list[dict[str, str]]:
    """A row a course."""
    packed = ROOT / "studies/docs/data/mass_courses.csv.gz"
    return list(csv.DictReader(gzip.decompress(packed.read_bytes()).decode().splitlines()))


def walked(plant: str, scale: str, parameters: str, torque_limit: str = "200") -> dict[int, bool]:
    """Whether each course was, by its number."""
    asked = {"plant": plant, "mass_scale": scale, "parameters": parameters, "torque_limit": torque_limit}
    return {int(row["run"]): row["success"] == "1" for row in rows() if asked.items() <= row.items()}


def count(plant: str, scale: str, parameters: str) -> int:
    """How many were."""
    return sum(walked(plant, scale, parameters).values())


def range_of_twenty(scale: str, parameters: str) -> str:
    """Of twenty other courses, in PyBullet."""
    low, high = of_so_many(20, count("pybullet", scale, parameters), COURSES)
    return f"{low} to {high}"


def text(path: str) -> str:
    """A page's words, each space one."""
    return " ".join((ROOT / path).read_text(encoding="utf-8").split())


@pytest.mark.parametrize("plant", ENGINES)
@pytest.mark.parametrize("scale", SCALES)
@pytest.mark.parametrize("parameters", WHO)
def test_they_are_the_first_courses_of_rabbit_evaluate(plant: str, scale: str, parameters: str) -> None:
    seeds = {int(row["run"]): int(row["seed"]) for row in rows()}
    assert seeds == episode_seeds(SEED, COURSES)
    assert sorted(walked(plant, scale, parameters)) == list(range(COURSES))


@pytest.mark.parametrize("parameters", WHO)
def test_a_course_walked_again_ends_as_its_row_says(parameters: str) -> None:
    """Run 3, at thrice the mass: all lose it."""
    assembly = WHO[parameters].assembly(stones=20, plant="mujoco", mass_scale=3.0)
    (row,) = (
        row
        for row in rows()
        if (row["plant"], row["mass_scale"], row["parameters"], row["torque_limit"], row["run"])
        == ("mujoco", "3", parameters, "200", "3")
    )
    result = walk(assembly, 3, int(row["seed"]))
    assert (result.outcome, str(int(result.success)), str(result.stones)) == (
        row["outcome"],
        row["success"],
        row["stones"],
    )


def test_the_readme_says_what_the_courses_say() -> None:
    readme, tuned = text("README.md"), "nominal_tuned"
    half, twice, thrice = (
        {who: [str(count(plant, scale, who)) for plant in ENGINES] for who in WHO} for scale in SCALES
    )
    assert f"the nominal one walks [{half[tuned][0]} in PyBullet and {half[tuned][1]} in MuJoCo]" in readme
    assert f"`best` {half['best'][0]} and {half['best'][1]}.*" in readme
    demo = f"of which they walk {thrice[tuned][0]} and {thrice['best'][0]}: of twenty, "
    assert f"{demo}{range_of_twenty('3', tuned)} and {range_of_twenty('3', 'best')}." in readme
    of_best = [f"{half['best'][i]}, {twice['best'][i]} and {thrice['best'][i]}" for i in range(len(ENGINES))]
    assert f"[{of_best[0]} of 200 courses]" in readme
    assert f"in MuJoCo {of_best[1]}.**" in readme
    assert f"at thrice the mass, {thrice['best'][0]} of 200 of another" in text("docs/results.md")


def test_twenty_courses_of_the_seed_that_one_gets_fall_into_the_range() -> None:
    for scale in SCALES:
        for who in WHO:
            low, high = of_so_many(20, count("pybullet", scale, who), COURSES)
            first = list(walked("pybullet", scale, who).items())[:20]
            assert low <= sum(ends_well for _, ends_well in first) <= high


def test_what_best_loses_at_thrice_the_mass_is_the_torque_s_limit() -> None:
    page = text("studies/docs/tuning.md")
    for plant, name in zip(ENGINES, ("PyBullet", "MuJoCo"), strict=True):
        lost = {run for run, ends_well in walked(plant, "3", "best").items() if not ends_well}
        oracle, stronger = (
            walked(plant, "3", who, limit) for who, limit in (("oracle-slopes", "200"), ("best", "300"))
        )
        assert set(oracle) == set(stronger) == lost
        by_none = [run for run in lost if not (oracle[run] or walked(plant, "3", "nominal_tuned")[run])]
        said = f"are walked by no method and {sum(stronger.values())} with 300 N m"
        assert f"{len(lost)} in {name}, of which {len(by_none)} {said}" in page
