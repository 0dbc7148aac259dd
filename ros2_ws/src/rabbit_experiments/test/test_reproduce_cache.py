"""Runs are found again by content: same content, no run; changed content, a new one; a stopped one goes on."""

import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.reproduce import jobs, runner, source_files
from rabbit_experiments.reproduce.cache import Cache
from rabbit_experiments.reproduce.controllers import CBF_CLF
from rabbit_experiments.reproduce.jobs import Job
from rabbit_experiments.reproduce.source_files import reached_from, sources_hash

JOB = Job("walk", CBF_CLF.assembly(stones=1), 7)


@pytest.fixture
def counted(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Seeds of the runs that are made."""
    seeds: list[int] = []
    do: Callable[[Job], Any] = Job.do

    def noted(job: Job) -> Any:
        seeds.append(job.seed)
        return do(job)

    monkeypatch.setattr(Job, "do", noted)
    return seeds


def plant(job: Job, **changes: Any) -> Job:
    """The job on another plant."""
    simulation = job.assembly.simulation.model_copy(update=changes)
    return replace(job, assembly=replace(job.assembly, simulation=simulation))


def law(job: Job, **changes: Any) -> Job:
    """The job with another controller."""
    controller = job.assembly.controller.model_copy(update=changes)
    return replace(job, assembly=replace(job.assembly, controller=controller))


def test_the_same_content_is_not_run_again(tmp_path: Path, counted: list[int]) -> None:
    assert runner.run([JOB, JOB], Cache(tmp_path), 1) == 1
    first = Cache(tmp_path).get(JOB)
    assert runner.run([replace(JOB, title="another title")], Cache(tmp_path), 1) == 0
    assert counted == [7]
    assert Cache(tmp_path).get(JOB) == first


@pytest.mark.parametrize(
    "other",
    [
        replace(JOB, seed=8),
        replace(JOB, kind="records"),
        plant(JOB, mass_scale=1.1),
        plant(JOB, plant="rigid"),
        law(JOB, eps=0.06),
        law(JOB, gait="authors_035"),
        replace(JOB, assembly=replace(JOB.assembly, policy="oracle")),
        replace(JOB, assembly=replace(JOB.assembly, nominal=("V",))),
        replace(JOB, kind="feasibility", judges=(JOB.assembly,)),
    ],
)
def test_changed_content_has_another_key(tmp_path: Path, other: Job) -> None:
    cache = Cache(tmp_path)
    assert cache.key(other) != cache.key(JOB)
    assert cache.key(JOB) == Cache(tmp_path / "elsewhere").key(JOB)


def test_judges_are_part_of_the_key(tmp_path: Path) -> None:
    one, two = (replace(JOB, kind="feasibility", judges=(JOB.assembly,) * n) for n in (1, 2))
    assert Cache(tmp_path).key(one) != Cache(tmp_path).key(two)


def test_policy_bytes_are_part_of_the_key(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = Cache(tmp_path).key(JOB)
    identity = Assembly.identity
    monkeypatch.setattr(Assembly, "identity", lambda self: identity(self) | {"policy_version": "other bytes"})
    assert Cache(tmp_path).key(JOB) != before


def test_changed_sources_rerun(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, counted: list[int]) -> None:
    assert runner.run([JOB], Cache(tmp_path), 1) == 1
    monkeypatch.setattr("rabbit_experiments.reproduce.cache.sources_hash", lambda *_: "changed")
    assert runner.run([JOB], Cache(tmp_path), 1) == 1
    assert counted == [7, 7]


def test_ctrl_c_loses_only_the_run_under_way(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, counted: list[int]
) -> None:
    wanted = [replace(JOB, seed=seed) for seed in (1, 2, 3)]
    noted = Job.do

    def stopped(job: Job) -> Any:
        if job.seed == 3:
            raise KeyboardInterrupt
        return noted(job)

    with monkeypatch.context() as patch:
        patch.setattr(Job, "do", stopped)
        with pytest.raises(KeyboardInterrupt):
            runner.run(wanted, Cache(tmp_path), 1)
    assert runner.run(wanted, Cache(tmp_path), 1) == 1
    assert counted == [1, 2, 3]


def test_a_broken_file_is_run_again(tmp_path: Path) -> None:
    cache = Cache(tmp_path)
    runner.run([JOB], cache, 1)
    (file,) = tmp_path.rglob("*.json")
    file.write_text("{")
    assert cache.get(JOB) is None
    assert runner.run([JOB], cache, 1) == 1


@pytest.mark.parametrize("kind", ["walk", "records", "feasibility"])
def test_results_are_read_as_they_were_written(tmp_path: Path, kind: jobs.Kind) -> None:
    judges = (JOB.assembly,) if kind == "feasibility" else ()
    job = replace(JOB, kind=kind, judges=judges)
    result = job.do()
    Cache(tmp_path).put(job, result)
    read = Cache(tmp_path).get(job)
    if kind == "records":
        assert (read.q == result.q).all()
        assert read.about == result.about
    else:
        assert repr(read) == repr(result)


def package(folder: Path, name: str) -> Path:
    """Three modules: a imports b, c is alone."""
    root = folder / name
    root.mkdir(parents=True)
    for module, text in (("__init__", ""), ("a", f"from {name}.b import B\n"), ("b", "B = 1\n"), ("c", "C = 1\n")):
        (root / f"{module}.py").write_text(text)
    return root


def test_hash_follows_imports_and_nothing_else(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    root = package(tmp_path, "three_modules")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(source_files, "OURS", ("three_modules",))
    assert set(reached_from("three_modules.a")) == {"three_modules", "three_modules.a", "three_modules.b"}
    before = sources_hash.__wrapped__("three_modules.a")
    (root / "c.py").write_text("C = 2\n")
    assert sources_hash.__wrapped__("three_modules.a") == before
    (root / "b.py").write_text("B = 2\n")
    assert sources_hash.__wrapped__("three_modules.a") != before
    assert "three_modules.a" not in sys.modules


def test_runs_depend_on_controller_and_plant_but_on_no_figure() -> None:
    reached = reached_from(*jobs.SOURCES["walk"])
    assert "cbf_clf_qp.tick" in reached
    assert {"rl_cbf_clf_controller.controller", "rabbit_sim.pybullet_plant", "rabbit_sim.rigid_plant"} <= set(reached)
    assert not [name for name in reached if "curves" in name or "catalogue" in name or "rl_trainer.training" in name]
