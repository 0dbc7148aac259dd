"""What learning buys beyond a higher gain: a fair comparison, and a page that says which claims fall."""

from types import SimpleNamespace
from typing import Any

import pytest
from rabbit_experiments.evaluation import SeededRun, Walk
from rabbit_experiments.metrics import RunResult, RunRow
from rabbit_reproduce.catalogue import EXPERIMENTS
from rabbit_reproduce.catalogue.higher_gain import ENGINES, WHO, HigherGain
from rabbit_reproduce.controllers import AT_ITS_BEST
from rabbit_reproduce.experiment import Experiment
from rabbit_reproduce.table_lines import FULL, RIGID, SEED, Found

ZEROS = {name: 0 for name, field in RunRow.model_fields.items() if field.annotation in (int, float)}
WALKED = RunRow.model_validate(
    ZEROS | {"outcome": "walked", "stones": 20, "success": True, "success_with_forces": True}
)


def test_at_each_point_every_controller_walks_the_same_courses_in_both_engines() -> None:
    lines = HigherGain().by_key
    for _, field, value in lines:
        for engine in ENGINES:
            scenarios = [lines[who, field, value].scenario(FULL, engine) for who in WHO]
            assert len({(each.seed, each.runs, each.assembly.simulation) for each in scenarios}) == 1
            assert scenarios[0].runs >= 20
            assert scenarios[0].assembly.simulation.plant == engine.plant
            assert getattr(scenarios[0].assembly.simulation, field) == value


def test_its_courses_are_nobody_else_s() -> None:
    def seeds(experiment: Experiment) -> set[int]:
        return {job.seed for job in experiment.jobs(FULL)}

    others = set[int]().union(*(seeds(each) for each in EXPERIMENTS if each.name != "higher-gain"))
    assert not seeds(HigherGain()) & others


def test_nominal_policy_and_oracle_have_the_same_gains_and_gait() -> None:
    nominal, _, _, policy, oracle, _ = (who.assembly().controller for who in WHO)
    for other in (policy, oracle):
        assert other.model_dump(exclude={"controller"}) == nominal.model_dump(exclude={"controller"})


@pytest.mark.parametrize("terrain", ["stones", "flat"])
def test_the_nominal_controller_at_its_best_learned_and_identifies_nothing(terrain: str) -> None:
    assembly = AT_ITS_BEST[terrain].assembly()
    assert assembly.policy == "zero"
    assert assembly.controller.adaptation == "none"
    assert not assembly.controller.learns
    assert assembly.controller.terrain == terrain


@pytest.mark.parametrize("experiment", [each for each in EXPERIMENTS if each.judged_on_rigid and each.by_key])
def test_the_nominal_controller_at_its_best_walks_beside_the_claims(experiment: Experiment) -> None:
    """On the same plants and courses."""

    def get(job: SeededRun) -> RunResult | None:
        return RunResult(row=WALKED, violations=[], tick_seconds=[]) if isinstance(job, Walk) else None

    cache: Any = SimpleNamespace(get=get, path="-")
    assert any(claim.undone for claim in experiment.claims(Found(cache, FULL, RIGID)))
    plants = [line.assembly.simulation for line in experiment.by_key.values()]
    for line in experiment.tuned.values():
        assert line.assembly.simulation in plants
        assert line.scenario(FULL).seed == SEED
