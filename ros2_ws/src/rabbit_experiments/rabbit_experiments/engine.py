"""The engine of all seeded runs: does the jobs that a cache lacks, over processes or a cluster, and keeps each result.

run(Scenario(assembly, runs=50, seed=9001).walks, Cache(Path("runs/nominal/cache")), processes=2)
"""

import os
import warnings
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import chain
from math import ceil
from typing import Any

import joblib
from rabbit_common.child_process import end_with_parent
from rabbit_description.user_code import fault_in_user_code
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    TaskID,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)
from rich.table import Column

from rabbit_experiments.cache import Cache, Job, JobError
from rabbit_experiments.conditions import BATCH
from rabbit_experiments.interrupts import interrupts_held

BAR_WIDTH = 20  # characters
SECONDS_A_WALK = 1.0  # of a core; measured in PyBullet (studies/docs/reproduce.md)
# loky replaces a worker that has grown by 300 MB, as by the controllers of many methods
warnings.filterwarnings("ignore", "A worker stopped while some jobs", UserWarning)


def run(
    jobs: Sequence[Job],
    cache: Cache,
    processes: int | str = 1,
    note: Callable[[Any, Any], str] = lambda job, _: str(job.title),
    batch: int = BATCH,
) -> int:
    """Do what the cache lacks, with a bar; returns how many were done. Ctrl-C loses only jobs under way.

    `processes`: how many, here, of which a single one does them in order; or the address of a cluster. At most `batch`
    jobs that are companions are done at once. `note(job, result)` is called once a result is kept; it returns what the
    bar says.

    Raises:
        JobError: of the first job that had no result, when the others are done.
    """
    errors: list[JobError] = []
    with progress_bar(TextColumn("{task.fields[workers]}")) as bar:
        task = bar.add_task("looks for what is done", total=len(jobs), workers="")
        by_key = {cache.key(job): (job, cache.get(job) is not None) for job in bar.track(jobs, task_id=task)}
        left = [job for job, is_done in by_key.values() if not is_done]
        if outdated := cache.outdated(left):
            bar.console.print(outdated, highlight=False, soft_wrap=True)
        bar.reset(task, total=len(by_key), completed=len(by_key) - len(left), description="")
        for job, result in _results(left, batch, processes, bar, task):
            try:
                if isinstance(result, JobError):
                    raise result
                cache.put(job, result)
            except JobError as error:
                errors.append(error)
                said = "\n".join([str(error), *getattr(error, "__notes__", ())])
                bar.console.print(said, highlight=False, soft_wrap=True, markup=False)
                continue
            bar.update(task, advance=1, description=note(job, result))
    if errors:
        raise errors[0]
    return len(left)


def about_so_long(walks: int, processes: int | str) -> str:
    """How long so many walks take, roughly: as in `about 2.5 h on 2 cores`; of a cluster, on one of its cores."""
    cores = 1 if isinstance(processes, str) else min(processes, os.cpu_count() or 1)
    minutes = walks * SECONDS_A_WALK / cores / 60
    said = f"{minutes:.0f} min" if minutes < 90 else f"{minutes / 60:.1f} h"
    return f"about {said} on {cores} {'core' if cores == 1 else 'cores'}"


def progress_bar(*more: ProgressColumn) -> Progress:
    """Done, of all, times, `more`, and of a text what the terminal has room for beside them."""
    text = TextColumn("{task.description}", table_column=Column(ratio=1, no_wrap=True, overflow="ellipsis"))
    columns = BarColumn(BAR_WIDTH), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn(), *more, text
    return Progress(*columns, expand=True)


def batches(jobs: Sequence[Job], most: int, processes: int) -> list[list[Job]]:
    """Companions together, at most so many, and no more than a process gets; the others alone."""
    groups: dict[Any, list[Job]] = {}
    for number, job in enumerate(jobs):
        companions = job.companions if most > 1 else None
        groups.setdefault(number if companions is None else companions, []).append(job)
    sizes = [(group, min(most, ceil(len(group) / processes))) for group in groups.values()]
    return [group[start : start + size] for group, size in sizes for start in range(0, len(group), size)]


def _results(
    left: Sequence[Job], batch: int, processes: int | str, bar: Progress, task: TaskID
) -> Iterator[tuple[Job, Any]]:
    """Jobs with their results, in the order in which they end."""
    if isinstance(processes, str):
        yield from _on_cluster(left, batch, processes, bar, task) if left else ()
        return
    groups = batches(left, batch, processes)
    if processes == 1 or len(groups) <= 1:
        yield from chain.from_iterable(map(_results_of, groups))
    else:
        begin = {"initializer": end_with_parent, "initargs": (os.getpid(),)}
        with joblib.parallel_config(backend="loky", n_jobs=processes, inner_max_num_threads=1, **begin):
            parallel = joblib.Parallel(return_as="generator_unordered", batch_size=1, pre_dispatch="n_jobs")
            with interrupts_held():
                results = parallel(joblib.delayed(_do)(jobs) for jobs in groups)
            yield from chain.from_iterable(results)


def _on_cluster(
    left: Sequence[Job], batch: int, address: str, bar: Progress, task: TaskID
) -> Iterator[tuple[Job, Any]]:
    try:
        from rabbit_experiments.cluster import Workers, connected
    except ImportError as error:
        install = "pip install 'rabbit_experiments[cluster]', or make studies"
        raise JobError(f"--cluster {address}: {error}: {install}") from None
    with connected(address) as client:
        warn = partial(bar.console.print, highlight=False, soft_wrap=True, markup=False)
        workers = Workers(client, lambda present: bar.update(task, workers=present), warn)
        results = workers.results(lambda count: batches(left, batch, count), _do)
        yield from chain.from_iterable(results)


def _do(jobs: list[Job]) -> list[tuple[Job, Any]]:
    try:
        return list(_results_of(jobs))
    except Exception as error:  # its traceback stays in this process
        if where := fault_in_user_code(error):
            raise JobError(where) from None
        raise


def _results_of(jobs: list[Job]) -> Iterator[tuple[Job, Any]]:
    """Several at once where they are companions; an error is of one that is alone."""
    if len(jobs) > 1:
        yield from type(jobs[0]).do_together(jobs)
        return
    for job in jobs:
        try:
            yield job, job.do()
        except JobError as error:
            yield job, error
