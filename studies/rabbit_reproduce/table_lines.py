"""Lines of a table: assemblies, their runs on four plants (PyBullet and rigid, with the motors' lag and without)."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

from rabbit_experiments.assembly import Assembly
from rabbit_experiments.cache import Cache
from rabbit_experiments.conditions import EVALUATION_LAG
from rabbit_experiments.evaluation import Scenario, SeededRun
from rabbit_experiments.summary import Walks
from rabbit_experiments.walk_records import WalkRecords
from rabbit_sim.parameters import SimulationParameters

from rabbit_reproduce.command_lines import evaluate_command
from rabbit_reproduce.report import Cell, Table
from rabbit_reproduce.training import Trained

SUMMED = (
    *("ticks", "ticks_over_cone", "ticks_over_cone_at_impact", "ticks_lost", "ticks_lost_at_impact"),
    *("missed_stones", "saturated_ticks", "slack_ticks", "rescue_ticks", "qp_unanswered_ticks"),
    "ecbf_start_violations",
)
PlantName = Literal["pybullet", "mujoco", "rigid"]
PLANT_TITLES: dict[PlantName, str] = {"pybullet": "PyBullet", "mujoco": "MuJoCo", "rigid": "rigid"}
SEED = 50001  # of every course and first state here, and of nothing else


@dataclass(frozen=True)
class Column:
    """A plant; PyBullet stands for the one that claims are judged on."""

    title: str
    plant: PlantName
    lag: float  # s


MAIN = Column("PyBullet", "pybullet", EVALUATION_LAG)
RIGID = Column("rigid", "rigid", EVALUATION_LAG)  # the paper's own kind
MUJOCO = Column("MuJoCo", "mujoco", EVALUATION_LAG)  # of few experiments, with as many runs as the main plant
COLUMNS = (
    MAIN,
    Column("PyBullet, no lag", "pybullet", 0.0),
    RIGID,
    Column("rigid, no lag", "rigid", 0.0),
)


@dataclass(frozen=True)
class Runs:
    """The runs of a line on the main plant, where they are not the size's own."""

    whole: int
    quick: int


@dataclass(frozen=True)
class Size:
    """How many runs: of a line on the main plant, and on each of the others; what `--retrain` has `trained`, if so.

    And the plant that claims are judged on.
    """

    quick: bool
    runs: int
    beside: int
    trained: Trained | None = None
    plant: PlantName = "pybullet"

    def own(self, assembly: Assembly) -> Assembly:
        """The assembly on this plant where it was on PyBullet, with the retrained policy if there is one."""
        if assembly.simulation.plant == "pybullet" != self.plant:
            changed = {**assembly.simulation.model_dump(), "plant": self.plant}
            assembly = replace(assembly, simulation=SimulationParameters.model_validate(changed))
        return self.trained.own(assembly) if self.trained else assembly

    def columns(self, columns: Sequence["Column"]) -> list["Column"]:
        """The columns with runs, none there twice: `plant` is the main one."""
        beside = [column for column in columns if column.plant == "pybullet" or column.plant != self.plant]
        return [column for column in beside if self.beside or column is MAIN]

    def title(self, column: "Column") -> str:
        """The title of a column."""
        return column.title.replace(MAIN.title, PLANT_TITLES[self.plant])


FULL, QUICK = Size(False, 10, 4), Size(True, 2, 1)
HEADLINE = Runs(20, 3)  # of the paper's own figures


@dataclass(frozen=True)
class Line:
    """A line of a table."""

    what: str
    assembly: Assembly
    paper: str = ""
    runs: Runs | None = None
    columns: tuple[Column, ...] = COLUMNS
    seed: int = SEED

    def scenario(self, size: Size, column: Column = MAIN) -> Scenario:
        """The line's runs on a plant."""
        plant = self.assembly.simulation.model_copy(update={"plant": column.plant, "motor_lag": column.lag})
        assembly = size.own(replace(self.assembly, simulation=plant))
        own = self.runs or Runs(size.runs, size.runs)
        runs = size.beside if column not in (MAIN, MUJOCO) else own.quick if size.quick else own.whole
        return Scenario(assembly, runs, self.seed, self.what)


@dataclass(frozen=True)
class Results:
    """Results that are in the cache, of runs of one size; `column` is the plant whose walks are meant."""

    cache: Cache
    size: Size
    column: Column = MAIN

    @property
    def on_rigid(self) -> "Results":
        """The same runs on the paper's own kind of plant."""
        return replace(self, column=RIGID)

    def result(self, job: SeededRun) -> Any:
        """A run's; raises `LookupError` where it was not made."""
        result = self.cache.get(job)
        if result is None:
            raise LookupError(f"{job.title}, seed {job.seed}: expected a result in {self.cache.path}")
        return result

    def walks(self, line: Line, column: Column | None = None) -> Walks:
        """The runs of a line on a plant."""
        scenario = line.scenario(self.size, column or self.column)
        rows = [self.result(job).row for job in scenario.walks]
        return Walks(rows, scenario.assembly.simulation.stones)

    def records(self, line: Line) -> WalkRecords:
        """All ticks of a line's first run, on the main plant."""
        records: WalkRecords = self.result(line.scenario(self.size).recorded)
        return records


def runs_table(lines: Sequence[Line], results: Results) -> Table:
    """A row for each line and plant, of which there are some."""
    rows = [_row(line, column, results) for line in lines for column in results.size.columns(line.columns)]
    return Table("runs", tuple(rows[0]), [tuple(row.values()) for row in rows])


def _row(line: Line, column: Column, results: Results) -> dict[str, Cell]:
    walks, scenario = results.walks(line, column), line.scenario(results.size, column)
    assembly, (low, high) = scenario.assembly, walks.interval
    mean_low, mean_high = walks.stones_interval or (None, None)
    policy = assembly.make_policy().version  # a hash of its bytes
    row: dict[str, Cell] = {"what": line.what, "paper": line.paper, "plant": assembly.simulation.plant}
    row |= {"motor_lag": column.lag, "policy": policy, "seed": scenario.seed, "runs": walks.runs}
    row |= {"walked": walks.walked, "low95": low, "high95": high, "walked_with_forces": walks.with_forces}
    row |= {"mean_stones": walks.mean_stones, "mean_low95": mean_low, "mean_high95": mean_high}
    row |= {"std_stones": walks.std_stones, "max_force_ratio": walks.max_ratio}
    row |= {"rms_y": walks.rms("rms_y"), "rms_dy": walks.rms("rms_dy")}
    row |= {name: walks.total(name) for name in SUMMED}
    falls = "; ".join(f"{kind} {count}" for kind, count in sorted(walks.falls.items()))
    return row | {"falls": falls, "command": evaluate_command(scenario)}
