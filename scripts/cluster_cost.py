"""What a cluster costs and saves.

python scripts/cluster_cost.py                    # ms a run of 1,000 that do nothing, here and by a scheduler
python scripts/cluster_cost.py MUJOCO PYBULLET ... OUT.csv  # the queue of the map's walks, from how long they took
"""

import csv
import heapq
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Literal

from pydantic import RootModel
from rabbit_benchmark.cells import cells
from rabbit_benchmark.methods import method
from rabbit_benchmark.protocol import Protocol, plan
from rabbit_benchmark.table import Table
from rabbit_experiments.cache import Cache, Job
from rabbit_experiments.cluster import loads
from rabbit_experiments.engine import batches, run

RUNS = 1000
OVERHEAD = 0.01  # s a job, of client and scheduler: they give out one after the other
CORES = (2, 64, 512)
BATCH, COURSES = 200, 10  # of the map
Plant = Literal["mujoco", "pybullet"]


@dataclass(frozen=True)
class Nothing(Job):
    """A job that does nothing but give its number."""

    number: int
    model = RootModel[int]

    def do(self) -> RootModel[int]:
        return RootModel[int](self.number)


def queue(seconds: Mapping[Job, float], repeated: int, cores: int) -> tuple[float, float]:
    """Hours until the last of all walks has ended, each `repeated`, and the share of that in which cores walk."""
    given_out = loads(batches([*seconds] * repeated, BATCH, cores), cores)
    jobs = [sum(seconds[job] for batch in load for job in batch) for load in given_out]
    free = [0.0] * cores
    for number, job in enumerate(jobs, 1):
        heapq.heappush(free, max(heapq.heappop(free), number * OVERHEAD) + job)
    return max(free) / 3600, sum(jobs) / (cores * max(free))


def walked(folder: Path, plant: Plant) -> tuple[dict[Job, float], int]:
    """Seconds of the walks of a benchmark in a folder, and how often the map has each."""
    table = Table.read(folder / "benchmark.csv")
    courses = min(row.courses for row in table.rows.values() if row.courses)
    protocol = Protocol(courses, "reported", plant=plant)
    planned = plan(protocol, [method(name) for name in table.methods], [cells()[name] for name in table.cells])
    cache, known = Cache(folder / "cache"), [jobs for jobs in planned.values() if not isinstance(jobs, str)]
    return {job: cache.get(job).row.walk_seconds for jobs in known for job in jobs}, COURSES // courses


def simulate(maps: Mapping[Plant, Sequence[Path]], out: Path) -> None:
    """A row for each engine and number of cores; an engine's map may be in several folders."""
    with out.open("w", encoding="utf-8", newline="") as file:
        table = csv.writer(file)
        table.writerow(("plant", "walks", "cores", "hours", "busy"))
        for plant, folders in maps.items():
            seconds: dict[Job, float] = {}
            for folder in folders:
                of_folder, repeated = walked(folder, plant)
                seconds |= of_folder
            for cores in CORES:
                hours, busy = queue(seconds, repeated, cores)
                table.writerow((plant, len(seconds) * repeated, cores, f"{hours:.3f}", f"{busy:.2f}"))


def measure() -> None:
    """The first runs start the workers."""
    from cluster_cost import Nothing  # whose module workers import

    for processes in (2, "local:2"):
        seconds = []
        for runs in (10, RUNS + 10):
            with TemporaryDirectory() as folder:
                start = time.perf_counter()
                run([Nothing(number) for number in range(runs)], Cache(Path(folder)), processes)
                seconds.append(time.perf_counter() - start)
        print(f"{processes}: {(seconds[1] - seconds[0]) / RUNS * 1000:.1f} ms a run")


if __name__ == "__main__":
    if sys.argv[1:]:
        mujoco, *pybullet, out = map(Path, sys.argv[1:])
        simulate({"mujoco": [mujoco], "pybullet": pybullet}, out)
    else:
        measure()
