"""Lines of a table: assemblies, their runs on four plants (PyBullet and rigid, with the motors' lag and without)."""

from dataclasses import dataclass, replace
from typing import Any, Literal

from rabbit_viewer.walk_records import WalkRecords

from rabbit_experiments.assembly import Assembly
from rabbit_experiments.cache import Cache, Job
from rabbit_experiments.conditions import EVALUATION_LAG
from rabbit_experiments.evaluation import Scenario
from rabbit_experiments.reproduce.training import Trained
from rabbit_experiments.summary import Walks

SEED = 50001  # of every course and first state here, where a line has no other, and of nothing else


@dataclass(frozen=True)
class Column:
    """A plant."""

    title: str
    plant: Literal["pybullet", "rigid"]
    lag: float  # s


MAIN = Column("PyBullet", "pybullet", EVALUATION_LAG)
RIGID = Column("rigid", "rigid", EVALUATION_LAG)  # the paper's own kind
COLUMNS = (
    MAIN,
    Column("PyBullet, no lag", "pybullet", 0.0),
    RIGID,
    Column("rigid, no lag", "rigid", 0.0),
)


@dataclass(frozen=True)
class Runs:
    """Of a line on the main plant, where they are not the size's own."""

    whole: int
    quick: int


@dataclass(frozen=True)
class Size:
    """How many runs: of a line on the main plant, and on each of the others; what `--retrain` has `trained`, if so."""

    quick: bool
    runs: int
    beside: int
    trained: Trained | None = None

    def own(self, assembly: Assembly) -> Assembly:
        """The same with a policy that was trained anew, where there is one."""
        return self.trained.own(assembly) if self.trained else assembly


FULL, QUICK = Size(False, 10, 4), Size(True, 2, 1)
HEADLINE = Runs(20, 3)  # of the paper's own figures


@dataclass(frozen=True)
class Line:
    """A line of a table; `nominal` is the nominal controller's on the same plant, if passing there shows nothing."""

    what: str
    assembly: Assembly
    paper: str = ""
    runs: Runs | None = None
    columns: tuple[Column, ...] = COLUMNS
    nominal: "Line | None" = None
    seed: int = SEED

    def scenario(self, size: Size, column: Column = MAIN) -> Scenario:
        """Its runs on a plant."""
        plant = self.assembly.simulation.model_copy(update={"plant": column.plant, "motor_lag": column.lag})
        assembly = size.own(replace(self.assembly, simulation=plant))
        return Scenario(assembly, self._runs(size, column), self.seed, self.what)

    def _runs(self, size: Size, column: Column) -> int:
        if column is not MAIN:
            return size.beside
        own = self.runs or Runs(size.runs, size.runs)
        return own.quick if size.quick else own.whole


@dataclass(frozen=True)
class Found:
    """Results that are in the cache, of runs of one size; `column` is the plant whose walks are meant."""

    cache: Cache
    size: Size
    column: Column = MAIN

    @property
    def on_rigid(self) -> "Found":
        """The same runs on the paper's own kind of plant."""
        return replace(self, column=RIGID)

    def result(self, job: Job) -> Any:
        """A run's; raises `LookupError` where it was not made."""
        result = self.cache.get(job)
        if result is None:
            raise LookupError(f"{job}: expected a result in {self.cache.path}")
        return result

    def policy(self, assembly: Assembly) -> str:
        """The version of its policy, a hash of the policy's bytes."""
        return self.cache.policy_version(assembly)

    def walks(self, line: Line, column: Column | None = None) -> Walks:
        """The runs of a line on a plant."""
        return Walks([self.result(job).row for job in line.scenario(self.size, column or self.column).walks])

    def records(self, line: Line) -> WalkRecords:
        """All ticks of a line's first run, on the main plant."""
        records: WalkRecords = self.result(line.scenario(self.size).recorded)
        return records
