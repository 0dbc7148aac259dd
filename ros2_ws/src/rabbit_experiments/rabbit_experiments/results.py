"""The folder of an evaluation, whose tables follow its runs; a command that was stopped goes on.

DIR/cache/              the runs that are done
DIR/runs.csv            a row a run
DIR/violations.csv      each stance tick over the friction cone, or without a push from the ground
DIR/summary.json        the figures over all runs; written last
"""

import shutil
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from rabbit_common.options import complaints, going_on_from
from rabbit_common.own_folder import own_folder

from rabbit_experiments.cache import Cache, Job, JobError
from rabbit_experiments.conditions import BATCH
from rabbit_experiments.engine import run
from rabbit_experiments.walk_records import RECORDS

PICTURES = "pictures"
RUNS, VIOLATIONS, SUMMARY = "runs.csv", "violations.csv", "summary.json"


def results_folder(out: Path | None, command: str, key: str) -> Path:
    """That of the command, without what follows its runs; by default one for each key."""
    folder = own_folder(out or Path("runs", f"{command.split()[0]}-{key[:8]}"), command)
    for name in (SUMMARY, RECORDS):
        (folder / name).unlink(missing_ok=True)
    shutil.rmtree(folder / PICTURES, ignore_errors=True)
    return folder


def results_of(
    jobs: Sequence[Job],
    folder: Path,
    processes: int | str,
    note: Callable[[list[Any]], str] = lambda results: f"{len(results)} done",
    batch: int = BATCH,
) -> tuple[list[Any], int]:
    """The results of all jobs, and how many the folder lacked; a signal or an error ends the command.

    `note` gets those so far, in the order of their jobs, and returns what the bar says: as soon as one is done, but
    for a tenth of the time at most; and at the end.
    """
    cache = Cache(folder / "cache")
    results = {job: result for job in jobs if (result := cache.get(job))}
    said, due = note([*results.values()]), 0.0

    def keep(job: Job, result: Any) -> str:
        nonlocal said, due
        results[job] = result
        if (begun := time.monotonic()) >= due:
            said, now = note([results[job] for job in jobs if job in results]), time.monotonic()
            due = now + 9 * (now - begun)
        return said

    try:
        with complaints(JobError), going_on_from("the runs that are done"):
            done = run(jobs, cache, processes, note=keep, batch=batch)
    finally:
        note([results[job] for job in jobs if job in results])
    return [results[job] for job in jobs], done
