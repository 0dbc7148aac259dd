"""What a run costs besides the walk: seconds of 1,000 runs that do nothing, here and on two workers of a scheduler."""

import time
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from pydantic import RootModel
from rabbit_experiments.cache import Cache, Job
from rabbit_experiments.engine import run

RUNS = 1000


@dataclass(frozen=True)
class Nothing(Job):
    """Its number."""

    number: int
    model = RootModel[int]

    def do(self) -> RootModel[int]:
        return RootModel[int](self.number)


def main() -> None:
    """Measure; the first runs start the workers."""
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
    main()
