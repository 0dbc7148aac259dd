"""Jobs on the workers of a Dask scheduler, which come and go: `--cluster ADDRESS` (studies/docs/cluster.md).

Batches go out in loads. A worker has at most two: it does one, and the other waits for it. The other loads wait in this
process. So whoever is killed (worker, scheduler, this process), only the loads that were out are done again. A worker
does a load only if its code, libraries, processor and files are those of this process.
"""

import re
import traceback
from collections import Counter, deque
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache
from ipaddress import ip_address
from itertools import chain
from math import ceil, inf
from queue import Empty, SimpleQueue
from time import monotonic
from typing import Any
from urllib.parse import urlsplit

from distributed import Client, Future, KilledWorker, LocalCluster

from rabbit_experiments.cache import Job, JobError
from rabbit_experiments.interrupts import interrupts_held
from rabbit_experiments.provenance import differing, plain, provenance
from rabbit_experiments.source_code import hash_of

INSECURE = "insecure:"
LOCAL = re.compile(r"local:([1-9]\d{0,3})")
LOOK = 1.0  # s, between two looks at who is there
LOSSES = 3  # workers that end with a batch before it is given up
PATIENCE = 60.0  # s, for a result to come
MOST_JOBS = 4  # in a load of single jobs: giving out a load takes as long, whatever is in it
LEAST_LOADS = 32  # that a worker gets, where there are so many jobs
Batch = list[Job]
Load = list[Batch]
Results = list[tuple[Job, Any]]


def loads(batches: list[Batch], workers: int) -> list[Load]:
    """The batches in loads: a batch of several jobs is a load; single jobs share one where there are many."""
    single = [batch for batch in batches if len(batch) == 1]
    size = min(MOST_JOBS, ceil(len(single) / (LEAST_LOADS * workers)))
    some = [single[start : start + size] for start in range(0, len(single), size or 1)]
    return [[batch] for batch in batches if len(batch) > 1] + some


class Workers:
    """The workers behind `client`. `tell` hears how many there are, `warn` which get no jobs, and why."""

    def __init__(self, client: Client, tell: Callable[[str], object], warn: Callable[[str], object]) -> None:
        self._client, self._tell, self._warn = client, tell, warn
        self._addresses: dict[str, str] = {}  # by a worker's identity
        self._refused: dict[str, str] = {}
        self._looked = -inf
        self._waiting: deque[Load] = deque()
        self._under_way: dict[Future[Results], tuple[str, Load]] = {}
        self._ended: SimpleQueue[Future[Results]] = SimpleQueue()
        self._losses: Counter[int] = Counter()  # by a batch's identity
        self._given_up: Results = []

    def results(self, batches: Callable[[int], list[Batch]], do: Callable[[Batch], Results]) -> Iterator[Results]:
        """What `do` answers to the `batches` for so many workers, in the order in which the answers come.

        Raises:
            JobError: the scheduler ended, or no worker gets jobs.
        """
        self._look()
        workers = max(1, len(self._addresses))
        self._waiting.extend(loads(batches(workers), workers))
        hash_file = cache(hash_of)
        while self._waiting or self._under_way:
            self._look()
            for worker in self._free():
                load = self._waiting.popleft()
                made_with, where = provenance(plain(load), hash_file), [self._addresses[worker]]
                future = self._client.submit(_do_with, made_with, do, load, workers=where, pure=False)
                self._under_way[future] = worker, load
                future.add_done_callback(self._ended.put)
            try:
                future = self._ended.get(timeout=LOOK)
            except Empty:
                continue
            if future in self._under_way:
                yield self._result(future, *self._under_way.pop(future))
            yield self._given_up
            self._given_up = []

    def _look(self) -> None:
        """Who is there? What was with workers that are gone waits again."""
        if self._client.status == "closed":
            raise JobError("the scheduler ended; the same command goes on when there is one")
        if monotonic() - self._looked < LOOK:
            return
        self._looked = monotonic()
        scheduler: Any = self._client.scheduler  # not `scheduler_info`: another thread may overwrite its answer
        try:
            known = self._client.sync(scheduler.identity, n_workers=-1)["workers"]
        except (AttributeError, OSError):  # there is none now
            self._tell("no scheduler")
            return
        self._addresses = {worker["id"]: address for address, worker in known.items()}
        for worker, address in self._addresses.items():
            if (threads := known[address]["nthreads"]) != 1:
                self._refuse(worker, f"{threads} threads, expected --nthreads 1")
        for future in [future for future, (worker, _) in self._under_way.items() if worker not in self._addresses]:
            self._lose(self._under_way.pop(future)[1])
            future.cancel()
        able = len(self._addresses.keys() - self._refused.keys())
        if self._addresses and not able:
            raise JobError(f"no worker gets jobs: {', '.join(self._refused.values())}")
        self._tell(f"{able} workers" if able != 1 else "1 worker")

    def _free(self) -> list[str]:
        """Workers that get one of the loads that wait. A worker gets a second only if there are more than workers."""
        if self._client.status != "running":
            return []
        count = Counter(worker for worker, _ in self._under_way.values())
        able = sorted(self._addresses.keys() - self._refused.keys(), key=count.__getitem__)
        most = 2 if len(self._waiting) > len(able) else 1
        return [worker for worker in able if count[worker] < most][: len(self._waiting)]

    def _result(self, future: "Future[Results]", worker: str, load: Load) -> Results:
        if future.status == "cancelled":  # the scheduler is gone
            self._waiting.appendleft(load)
            return []
        try:
            return future.result(timeout=PATIENCE)
        except (KilledWorker, TimeoutError):  # or it ended before its result was fetched
            self._lose(load)
        except Exception as error:  # of `_do_with`, or it cannot read what is asked
            self._refuse(worker, str(error) if isinstance(error, JobError) else f"{type(error).__name__}: {error}")
            self._waiting.appendleft(load)
        return []

    def _lose(self, load: Load) -> None:
        """The batches wait again, each by itself."""
        for batch in load:
            self._losses[id(batch)] += 1
            if self._losses[id(batch)] < LOSSES:
                self._waiting.appendleft([batch])
            else:
                self._given_up.append((batch[0], JobError(f"{batch[0].title}: {LOSSES} workers ended with it")))

    def _refuse(self, worker: str, why: str) -> None:
        if worker not in self._refused:
            self._refused[worker] = f"{self._addresses.get(worker, worker)}: {why}"
            self._warn(f"gets no jobs: worker {self._refused[worker]}")


@contextmanager
def connected(address: str) -> Iterator[Client]:
    """A client of the scheduler there, or of a new one here: `local:3` has three workers.

    Raises:
        JobError: nobody answers, or others could read and send what goes there: it would be code that runs.
    """
    scheduler: str | LocalCluster
    try:
        if local := LOCAL.fullmatch(address):
            alone: dict[str, Any] = {"threads_per_worker": 1, "memory_limit": None, "worker_dashboard_address": None}
            alone["scheduler_kwargs"] = {"dashboard": False, "dashboard_address": "127.0.0.1:0"}  # any port: no warning
            with interrupts_held():
                scheduler = LocalCluster(int(local[1]), host="127.0.0.1", **alone)
        else:
            scheduler = _checked(address)
        client = Client(scheduler, set_as_default=False)
    except (OSError, TypeError, ValueError) as error:
        raise JobError(f"--cluster {address}: {error}") from None
    try:
        yield client
    finally:
        client.close()
        if isinstance(scheduler, LocalCluster):
            scheduler.close()


def _checked(address: str) -> str:
    if address.startswith("local:"):
        raise ValueError("expected local:1 to local:9999")
    asked = address.removeprefix(INSECURE)
    place = urlsplit(asked if "://" in asked else f"tcp://{asked}")
    try:
        is_here = place.hostname == "localhost" or ip_address(place.hostname or "").is_loopback
    except ValueError:
        is_here = False
    if asked == address and place.scheme != "tls" and not is_here:
        raise ValueError(
            "whoever reaches this port runs code on all workers: expected tls://, or, in a network that you trust,"
            f" {INSECURE}{address}"
        )
    return asked


def _do_with(made_with: dict[str, str], do: Callable[[Batch], Results], load: Load) -> Results:
    """Does a load on a worker: raises JobError where files, code or libraries differ; a job's error is its result."""
    if others := differing(made_with, provenance(plain(load))):
        raise JobError(f"another {', '.join(others)}")
    return [*chain.from_iterable(_done(do, batch) for batch in load)]


def _done(do: Callable[[Batch], Results], batch: Batch) -> Results:
    try:
        return do(batch)
    except JobError as error:
        return [(batch[0], error)]
    except Exception as error:
        fault = JobError(f"{batch[0].title}: {error!r}")
        fault.add_note(traceback.format_exc())
        return [(batch[0], fault)]
