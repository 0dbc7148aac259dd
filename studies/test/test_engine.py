"""Runs over processes: one that cannot be made, a signal. That two processes make the same: tests/metamorphic."""

import os
import signal
import threading
import time
from pathlib import Path
from typing import Any

import pytest
from rabbit_experiments import engine, interrupts
from rabbit_experiments.cache import Cache, JobError
from rabbit_experiments.evaluation import Walk
from rabbit_reproduce.controllers import CBF_CLF

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


@pytest.mark.parametrize("number", interrupts.ENDING)
def test_a_signal_while_workers_start_is_heard_afterwards(number: int) -> None:
    """Also where another thread catches it, as that of the progress bar may."""
    said: list[str] = []
    before = signal.signal(number, lambda *_: said.append("heard"))
    over = threading.Event()
    other = threading.Thread(target=over.wait)
    other.start()
    try:
        with interrupts.interrupts_held():
            os.kill(os.getpid(), number)
            time.sleep(0.05)
            said.append("workers have started")
        assert said == ["workers have started", "heard"]
    finally:
        signal.signal(number, before)
        over.set()
        other.join()
