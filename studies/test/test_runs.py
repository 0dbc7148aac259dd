"""Runs over processes: found again by content, one that cannot be made, a signal. The same: tests/metamorphic."""

import os
import shutil
import signal
import threading
import time
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from rabbit_experiments import engine
from rabbit_experiments.cache import Cache, JobError
from rabbit_experiments.engine import run
from rabbit_experiments.evaluation import RecordedWalk, SeededRun, Walk, record_walk
from rabbit_experiments.interrupts import ENDING, interrupts_held
from rabbit_reproduce.controllers import CBF_CLF, RL_CBF_CLF
from rabbit_reproduce.feasibility import JudgedWalk
from rl_cbf_clf_controller.weights import SHIPPED

JOB = Walk(CBF_CLF.assembly(stones=1), 7)


def test_the_same_content_is_not_run_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    seeds, do = list[int](), Walk.do

    def noted(job: Walk) -> Any:
        seeds.append(job.seed)
        return do(job)

    monkeypatch.setattr(Walk, "do", noted)
    assert run([JOB, JOB], Cache(tmp_path), 1) == 1
    first = Cache(tmp_path).get(JOB)
    assert run([replace(JOB, title="another title")], Cache(tmp_path), 1) == 0
    assert seeds == [7]
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


WANTED = [Walk(CBF_CLF.assembly(stones=1), seed) for seed in range(4)]


def test_a_job_without_a_result_leaves_the_others(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    do = Walk.do

    def instead(job: Walk) -> Any:
        if job.seed == 0:
            raise JobError("seed 0: no such state")
        return do(job)

    monkeypatch.setattr(Walk, "do", instead)
    with pytest.raises(JobError, match="seed 0: no such state"):
        engine.run(WANTED, Cache(tmp_path), 1)
    assert [Cache(tmp_path).get(job) is None for job in WANTED] == [True, False, False, False]


@pytest.mark.parametrize("number", ENDING)
def test_a_signal_while_workers_start_is_heard_afterwards(number: int) -> None:
    """Also where another thread catches it, as that of the progress bar may."""
    said: list[str] = []
    before = signal.signal(number, lambda *_: said.append("heard"))
    over = threading.Event()
    other = threading.Thread(target=over.wait)
    other.start()
    try:
        with interrupts_held():
            os.kill(os.getpid(), number)
            time.sleep(0.05)
            said.append("workers have started")
        assert said == ["workers have started", "heard"]
    finally:
        signal.signal(number, before)
        over.set()
        other.join()


def test_a_policy_file_of_the_same_age_is_read_again(tmp_path: Path) -> None:
    path = tmp_path / "policy.safetensors"
    shutil.copy(SHIPPED / "rl-cbf-clf-qp.safetensors", path)
    assembly = RL_CBF_CLF.with_policy(str(path)).assembly(plant="rigid", stones=3)
    before, age = record_walk(assembly, 5).about, path.stat()
    path.write_bytes((SHIPPED / "rl-cbf-clf-qp-scale-0.7.safetensors").read_bytes())
    os.utime(path, ns=(age.st_atime_ns, age.st_mtime_ns))
    assert record_walk(assembly, 5).about["policy"] != before["policy"]
