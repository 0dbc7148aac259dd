"""Lines of a table: assemblies, their runs on four plants (PyBullet and rigid, with the motors' lag and without)."""

from dataclasses import dataclass, replace
from typing import Any, Literal

from rabbit_bringup.experiments.assembly import EVALUATION_LAG, Assembly
from rabbit_bringup.reproduce.cache import Cache
from rabbit_bringup.reproduce.jobs import Job
from rabbit_bringup.reproduce.walks import Case, Walks
from rabbit_bringup.viewing.walk_records import WalkRecords


@dataclass(frozen=True)
class Column:
    """A plant."""

    title: str
    plant: Literal["pybullet", "rigid"]
    lag: float  # s


MAIN = Column("PyBullet", "pybullet", EVALUATION_LAG)
COLUMNS = (
    MAIN,
    Column("PyBullet, no lag", "pybullet", 0.0),
    Column("rigid", "rigid", EVALUATION_LAG),
    Column("rigid, no lag", "rigid", 0.0),
)


@dataclass(frozen=True)
class Size:
    """How many runs: of a line on the main plant, and on each of the others."""

    quick: bool
    runs: int
    beside: int


FULL, QUICK = Size(False, 20, 10), Size(True, 3, 1)


@dataclass(frozen=True)
class Line:
    """A line of a table; `least` runs of it also where the size has fewer."""

    what: str
    assembly: Assembly
    paper: str = ""
    least: int = 0

    def case(self, size: Size, column: Column = MAIN) -> Case:
        """Its runs on a plant."""
        plant = self.assembly.simulation.model_copy(update={"plant": column.plant, "motor_lag": column.lag})
        runs = max(size.runs, self.least) if column is MAIN else size.beside
        return Case(replace(self.assembly, simulation=plant), runs, self.what)


@dataclass(frozen=True)
class Found:
    """Results that are in the cache, of runs of one size."""

    cache: Cache
    size: Size

    def result(self, job: Job) -> Any:
        """A run's; raises `LookupError` where it was not made."""
        result = self.cache.get(job)
        if result is None:
            raise LookupError(f"{job.title}, seed {job.seed}: expected a result in {self.cache.path}")
        return result

    def policy(self, assembly: Assembly) -> str:
        """The version of its policy, a hash of the policy's bytes."""
        return str(self.cache.identity(assembly)["policy_version"])

    def walks(self, line: Line, column: Column = MAIN) -> Walks:
        """The runs of a line on a plant."""
        return Walks([self.result(job) for job in line.case(self.size, column).jobs])

    def records(self, line: Line) -> WalkRecords:
        """All ticks of a line's first run."""
        records: WalkRecords = self.result(line.case(self.size).records)
        return records
