"""Make experiments: their runs, then report, figures and the page."""

from collections.abc import Sequence
from pathlib import Path

from rabbit_experiments.cache import Cache
from rabbit_experiments.engine import Backend, run
from rabbit_experiments.reproduce.experiment import Experiment
from rabbit_experiments.reproduce.page import write_page
from rabbit_experiments.reproduce.table_lines import Found, Size


def make(
    experiments: Sequence[Experiment],
    size: Size,
    out: Path,
    names: Sequence[str],
    jobs: int = 1,
    backend: Backend = "loky",
) -> tuple[Path, int]:
    """Run what the cache in `out` lacks, then write; the page has all of `names` that `out` holds.

    What is stopped by Ctrl-C leaves the experiments whose runs are complete.

    Returns:
        The page, and how many runs were made.

    Raises:
        BackendError: see `run`.
    """
    cache = Cache(out / "cache")
    try:
        done = run([job for each in experiments for job in each.jobs(size)], cache, jobs, backend)
    except KeyboardInterrupt:
        _write([each for each in experiments if all(cache.get(job) for job in each.jobs(size))], cache, size, out)
        write_page(out, names)
        raise
    _write(experiments, cache, size, out)
    return write_page(out, names), done


def _write(experiments: Sequence[Experiment], cache: Cache, size: Size, out: Path) -> None:
    for experiment in experiments:
        report, figures = experiment.report(Found(cache, size))
        report.write(out, figures)
