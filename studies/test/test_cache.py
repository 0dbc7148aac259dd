"""Results are found again by content: same content, no run; changed content, a new one; a stopped one goes on."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rabbit_experiments.cache import Cache
from rabbit_experiments.engine import run
from rabbit_experiments.evaluation import RecordedWalk, SeededRun, Walk
from rabbit_reproduce.controllers import CBF_CLF
from rabbit_reproduce.feasibility import JudgedWalk

JOB = Walk(CBF_CLF.assembly(stones=1), 7)


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Seeds of the runs that are made."""
    seeds: list[int] = []
    do = Walk.do

    def noted(job: Walk) -> Any:
        seeds.append(job.seed)
        return do(job)

    monkeypatch.setattr(Walk, "do", noted)
    return seeds


def test_the_same_content_is_not_run_again(tmp_path: Path, counted: list[int]) -> None:
    assert run([JOB, JOB], Cache(tmp_path), 1) == 1
    first = Cache(tmp_path).get(JOB)
    assert run([replace(JOB, title="another title")], Cache(tmp_path), 1) == 0
    assert counted == [7]
    assert Cache(tmp_path).get(JOB) == first


@pytest.mark.parametrize(
    "job", [JOB, RecordedWalk(JOB.assembly, 7), JudgedWalk(JOB.assembly, 7, (JOB.assembly,))], ids=lambda job: type(job)
)
def test_results_are_read_as_they_were_written(tmp_path: Path, job: SeededRun) -> None:
    result = job.do()
    Cache(tmp_path).put(job, result)
    read = Cache(tmp_path).get(job)
    if isinstance(job, RecordedWalk):
        assert (read.q == result.q).all()
        assert read.about == result.about
    else:
        assert repr(read) == repr(result)
