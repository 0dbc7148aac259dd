"""The engine of all seeded runs: does the jobs that a cache lacks, over processes, and keeps each result.

run(Scenario(assembly, runs=50, seed=9001).walks, Cache(Path("runs/nominal/cache")), processes=2)
"""

import os
import signal
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from itertools import chain
from math import ceil
from multiprocessing import resource_tracker
from threading import current_thread, main_thread
from typing import Any

import joblib
from joblib.externals.loky.backend import resource_tracker as loky_tracker
from rabbit_common.child_process import end_with_parent
from rabbit_description.user_code import fault_in_user_code
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn
from rich.table import Column

from rabbit_experiments.cache import Cache, Job, JobError
from rabbit_experiments.conditions import BATCH

BAR_WIDTH = 20  # characters
ENDING = (signal.SIGINT, signal.SIGTERM)
SECONDS_A_WALK = 1.0  # of a core; measured in PyBullet (studies/docs/reproduce.md)


def run(
    jobs: Sequence[Job],
    cache: Cache,
    processes: int = 1,
    note: Callable[[Any, Any], str] = lambda job, _: str(job.title),
    batch: int = BATCH,
) -> int:
    """Do what the cache lacks, with a bar; returns how many were done. Ctrl-C loses only jobs under way.

    One process does them here and in order. At most `batch` jobs that are companions are done at once. `note(job,
    result)` is called once a result is kept; it returns what the bar says.

    Raises:
        JobError: of the first job that had no result, when the others are done.
    """
    errors: list[JobError] = []
    with progress_bar() as bar:
        task = bar.add_task("looks for what is done", total=len(jobs))
        found = {cache.key(job): (job, cache.get(job) is not None) for job in bar.track(jobs, task_id=task)}
        left = [job for job, is_done in found.values() if not is_done]
        if outdated := cache.outdated(left):
            bar.console.print(outdated, highlight=False, soft_wrap=True)
        bar.reset(task, total=len(found), completed=len(found) - len(left), description="")
        for job, result in _results(batches(left, batch, processes), processes):
            try:
                if isinstance(result, JobError):
                    raise result
                cache.put(job, result)
            except JobError as error:
                errors.append(error)
                bar.console.print(error, highlight=False, soft_wrap=True)
                continue
            bar.update(task, advance=1, description=note(job, result))
    if errors:
        raise errors[0]
    return len(left)


def about_so_long(walks: int, processes: int) -> str:
    """How long so many walks take, roughly: as in `about 2.5 h on 2 cores`."""
    cores = min(processes, os.cpu_count() or 1)
    minutes = walks * SECONDS_A_WALK / cores / 60
    said = f"{minutes:.0f} min" if minutes < 90 else f"{minutes / 60:.1f} h"
    return f"about {said} on {cores} {'core' if cores == 1 else 'cores'}"


def progress_bar() -> Progress:
    """Done, of all, times, and of a text what the terminal has room for beside them."""
    text = TextColumn("{task.description}", table_column=Column(ratio=1, no_wrap=True, overflow="ellipsis"))
    columns = BarColumn(BAR_WIDTH), MofNCompleteColumn(), TimeElapsedColumn(), TimeRemainingColumn(), text
    return Progress(*columns, expand=True)


def batches(jobs: Sequence[Job], most: int, processes: int) -> list[list[Job]]:
    """Companions together, at most so many, and no more than each process gets; the others alone."""
    groups: dict[Any, list[Job]] = {}
    for number, job in enumerate(jobs):
        companions = job.companions if most > 1 else None
        groups.setdefault(number if companions is None else companions, []).append(job)
    found = []
    for group in groups.values():
        size = min(most, ceil(len(group) / processes))
        found += [group[start : start + size] for start in range(0, len(group), size)]
    return found


def _results(left: Sequence[list[Job]], processes: int) -> Iterator[tuple[Job, Any]]:
    """Jobs with their results, in the order in which they end."""
    if processes == 1 or len(left) <= 1:
        yield from chain.from_iterable(map(_each, left))
    else:
        begin = {"initializer": end_with_parent, "initargs": (os.getpid(),)}
        with joblib.parallel_config(backend="loky", n_jobs=processes, inner_max_num_threads=1, **begin):
            parallel = joblib.Parallel(return_as="generator_unordered", batch_size=1, pre_dispatch="n_jobs")
            with _interrupts_held():
                results = parallel(joblib.delayed(_do)(jobs) for jobs in left)
            yield from chain.from_iterable(results)


@contextmanager
def _interrupts_held() -> Iterator[None]:
    """Workers that are started meanwhile never hear a Ctrl-C, which reaches the whole group: they inherit the mask.

    Here a signal is heard afterwards. Any thread may catch it, and an exception would cut short a worker's start.
    """
    for tracker in (resource_tracker, loky_tracker):
        tracker.ensure_running()  # whose start would let it in
    heard: list[int] = []
    is_main = current_thread() is main_thread()
    handlers = {each: signal.signal(each, lambda number, _: heard.append(number)) for each in ENDING if is_main}
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for number, handler in handlers.items():
            signal.signal(number, handler)
    if heard:
        signal.raise_signal(heard[0])


def _do(jobs: list[Job]) -> list[tuple[Job, Any]]:
    try:
        return list(_each(jobs))
    except Exception as error:  # its traceback stays in this process
        if where := fault_in_user_code(error):
            raise JobError(where) from None
        raise


def _each(jobs: list[Job]) -> Iterator[tuple[Job, Any]]:
    """Several at once where they are companions; an error is of one that is alone."""
    if len(jobs) > 1:
        yield from type(jobs[0]).do_together(jobs)
        return
    for job in jobs:
        try:
            yield job, job.do()
        except JobError as error:
            yield job, error
