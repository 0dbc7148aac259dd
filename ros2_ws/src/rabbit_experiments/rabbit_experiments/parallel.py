"""Calls spread over processes of this machine."""

import signal
from collections.abc import Callable, Iterator, Sequence
from typing import Any, TypeVar

import joblib

T = TypeVar("T")


def in_processes(function: Callable[..., T], calls: Sequence[tuple[Any, ...]], jobs: int) -> Iterator[T]:
    """What `function` returns for the arguments of each call, in the order in which the calls end.

    One job, or one call, runs in this process and in order. Each worker has one thread.
    """
    if jobs == 1 or len(calls) <= 1:
        yield from (function(*call) for call in calls)
        return
    with joblib.parallel_config(backend="loky", n_jobs=jobs, inner_max_num_threads=1):
        parallel = joblib.Parallel(return_as="generator_unordered", batch_size=1, pre_dispatch="n_jobs")
        yield from parallel(joblib.delayed(_in_worker)(function, *call) for call in calls)


def _in_worker(function: Callable[..., T], *arguments: Any) -> T:
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C reaches the whole group; the parent ends the workers
    return function(*arguments)
