"""Do the jobs that the cache does not hold, over processes or machines by joblib; each result is kept as it comes."""

from collections.abc import Iterator, Sequence
from typing import Literal

import joblib
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from rabbit_experiments.parallel import in_processes
from rabbit_experiments.reproduce.cache import Cache
from rabbit_experiments.reproduce.jobs import Job, Result

Backend = Literal["loky", "ray"]
ROUND = 8  # jobs a process between two returns of Ray, which hands nothing back before a round is over
COLUMNS = (
    BarColumn(),
    MofNCompleteColumn(),
    TimeElapsedColumn(),
    TimeRemainingColumn(),
    TextColumn("{task.description}"),
)


class BackendError(RuntimeError):
    """A joblib backend that is not there."""


def run(wanted: Sequence[Job], cache: Cache, jobs: int, backend: Backend = "loky") -> int:
    """Do what is left of `wanted`, with a bar; returns how many were done. Ctrl-C loses only runs under way.

    Raises:
        BackendError: Ray is asked for and not installed.
    """
    unique = list({cache.key(job): job for job in wanted}.values())
    left = [job for job in unique if cache.get(job) is None]
    with Progress(*COLUMNS) as progress:
        task = progress.add_task("", total=len(unique), completed=len(unique) - len(left))
        for job, result in _results(left, jobs, backend):
            cache.put(job, result)
            progress.update(task, advance=1, description=job.title)
    return len(left)


def _results(left: Sequence[Job], jobs: int, backend: Backend) -> Iterator[tuple[Job, Result]]:
    """Jobs with their results, in any order."""
    if backend == "ray":
        yield from _through_ray(left, jobs)
    else:
        yield from in_processes(_do, [(job,) for job in left], jobs)


def _through_ray(left: Sequence[Job], jobs: int) -> Iterator[tuple[Job, Result]]:
    """The cluster that RAY_ADDRESS names, or one on this machine; every machine has the same installation."""
    try:
        from ray.util.joblib import register_ray
    except ImportError as error:
        raise BackendError("--backend ray: expected Ray: pip install 'rabbit_experiments[ray]'") from error
    register_ray()
    with joblib.parallel_config(backend="ray", n_jobs=jobs):
        for first in range(0, len(left), ROUND * jobs):
            some = left[first : first + ROUND * jobs]
            yield from joblib.Parallel(batch_size=1)(joblib.delayed(_do)(job) for job in some)


def _do(job: Job) -> tuple[Job, Result]:
    return job, job.do()
