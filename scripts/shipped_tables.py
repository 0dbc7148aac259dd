"""The shipped tables: what is counted in them, and the tables that pages show."""

import json
import math
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cache, partial

from common import ROOT
from rabbit_benchmark.cells import TERRAINS, Map, cells
from rabbit_benchmark.comparison import holm, of_so_many
from rabbit_benchmark.methods import method
from rabbit_benchmark.table import Table, rate_text
from rabbit_experiments.summary import wilson
from rabbit_experiments.tables import markdown_table
from rabbit_reproduce.report import CLAIMS, RUNS, Verdict, read_rows

DATA = ROOT / "studies" / "docs" / "data"
REPRODUCED = ROOT / "studies" / "docs" / "reproduced"
MAPS: tuple[Map, ...] = ("inside", "outside", "storm", "storm-2", "reported")
UNSEEN = {
    "best": "`best`",
    "nominal-tuned": "tuned nominal",
    "best-before": "`best-before`",
    "oracle-slopes": "oracle, gaits for slopes",
    "dagger": "`dagger`",
    "ppo": "`ppo`",
}


@cache
def shipped(name: str) -> list[dict[str, str]]:
    """The rows of a table."""
    return read_rows(DATA / f"{name}.csv")


@cache
def table(name: str) -> Table:
    """A shipped one; that of PyBullet's map is in parts."""
    parts = [Table.read(path) for path in sorted(DATA.glob(f"{name}*.csv"))]
    return Table(row for part in parts for row in part.rows.values())


def where(*maps: Map, terrains: Sequence[str] = TERRAINS) -> list[str]:
    """The cells of some maps."""
    return [cell.name for cell in cells().values() if cell.map in maps and cell.terrain in terrains]


STONES: Sequence[str] = ("stones",)
FLAT: Sequence[str] = ("flat",)


def walked(name: str, method: str, *maps: Map, terrains: Sequence[str] = TERRAINS) -> int:
    """Courses that a method walked there."""
    return table(name).walked(method, where(*maps, terrains=terrains))


def courses(name: str, *maps: Map, terrains: Sequence[str] = TERRAINS) -> int:
    """All courses there."""
    return table(name).courses("best", where(*maps, terrains=terrains))


LARGE, LARGE_PYBULLET = "benchmark_mujoco", "benchmark_pybullet"
large, unseen, harm = (partial(walked, name) for name in (LARGE, "unseen_mujoco", "no_harm_mujoco"))


def interval(name: str, this: str, other: str, *maps: Map, terrains: Sequence[str] = TERRAINS) -> list[str]:
    """How many more of a hundred courses one walks than another, and its 95% interval; `#` as on a page."""
    pair = table(name).paired(this, other, where(*maps, terrains=terrains))
    if pair:
        return [signed(share) for share in pair.difference]
    one, two = (walked(name, who, *maps, terrains=terrains) for who in (this, other))
    return [signed((one - two) / courses(name, *maps, terrains=terrains)), "#", "#"]


def points(name: str, this: str, other: str, *maps: Map, terrains: Sequence[str] = TERRAINS) -> str:
    """The same, as in `+11 (+6 to +15)`."""
    return "{} ({} to {})".format(*interval(name, this, other, *maps, terrains=terrains))


def signed(share: float, digits: int = 0) -> str:
    """A share in hundredths, a half rounded away from 0."""
    value = math.copysign(math.floor(abs(share) * 100 * 10**digits + 0.5 + 1e-9) / 10**digits, share)
    return f"{value:+.{digits}f}" if value else "0"


def p_values(name: str, reference: str) -> dict[str, float]:
    """McNemar's with Holm's correction, by method; empty where a row does not say how each course ended."""
    others = [who for who in table(name).methods if who != reference]
    pairs = [table(name).paired(who, reference, where(*MAPS)) for who in others]
    known = [pair.p_value for pair in pairs if pair]
    return dict(zip(others, holm(known), strict=True)) if len(known) == len(pairs) else {}


def large_table(name: str) -> str:
    """Courses walked by each method on each map."""
    head, lines, maps = ["method"], [], [region for region in MAPS if courses(name, region)]
    for terrain in TERRAINS:
        for number, region in enumerate(maps):
            size = courses(name, region, terrains=(terrain,))
            is_new = region in ("inside", "outside", "storm")
            head.append(("" if number else f"{terrain}: ") + region + (f", of {size}" if is_new else ""))
    rows = table(name)
    for who in rows.methods:
        there = [where(region, terrains=(terrain,)) for terrain in TERRAINS for region in maps]
        lines.append([method(who).title, *rows.counts(who, there)])
    return markdown_table([*head, f"all, of {courses(name, *maps):,}"], lines)


def no_harm_table() -> str:
    """Courses of `best` and the tuned nominal controller in PyBullet, on each map and terrain."""
    name, lines = "no_harm_pybullet", []
    for terrain in TERRAINS:
        for region in (*MAPS, "development"):
            here = partial(walked, name, terrains=(terrain,))
            counts = here("best", region), here("nominal-tuned", region), courses(name, region, terrains=(terrain,))
            gain = points(name, "best", "nominal-tuned", region, terrains=(terrain,))
            lines.append([f"{terrain}: {region}, {counts[2]:,}", *(f"{count:,}" for count in counts[:2]), gain])
    return markdown_table(["courses", "`best`", "tuned nominal", "points"], lines)


def leaderboard() -> str:
    """The row of `best`, as `rabbit benchmark` writes one."""
    maps = {f"{region}, {terrain}": where(region, terrains=(terrain,)) for terrain in TERRAINS for region in MAPS}
    sizes = [table(LARGE).courses("best", cells) for cells in maps.values()]
    made = json.loads((DATA / "tables.json").read_text(encoding="utf-8"))["map"]
    about = str(made["seeds"]), ENGINES["mujoco"], made["commit"]
    return table(LARGE).leaderboard({"best": "`best`, for comparison"}, maps, sizes, about)


def unseen_table() -> str:
    """Courses walked of each unseen family."""
    lines = [
        [f"`{cell}`", *(str(table("unseen_mujoco").walked(one, [cell])) for one in UNSEEN)] for cell in where("unseen")
    ]
    return markdown_table(["family, of 40, MuJoCo", *UNSEEN.values()], lines)


TASKS = {"cart_pole": "cart-pole (m)", "segway": "Segway (m/s)", "obstacle_arm": "arm (m)"}
ENDED = ("folder", "controller", "seed", "ticks", "outcome", "reason", "kept", "impacts")  # of a ride; then barriers
Runs = dict[str, dict[str, tuple[int, int]]]


@cache
def gains() -> Runs:
    """Courses of 20 walked in PyBullet and in MuJoCo, by mass or payload, then by controller."""
    runs: Runs = {}
    rows = [row for row in read_rows(REPRODUCED / RUNS) if row["experiment"] == "higher-gain"]
    for one, other in zip(rows[::2], rows[1::2], strict=True):
        what, _, value = one["what"].rpartition(": ")
        name, _, plant = what.rpartition(", ")
        title = f"mass scale {value}" if plant.startswith("mass") else f"{value} kg"
        if title != "0 kg":  # which is mass scale 1
            runs.setdefault(title, {})[name] = (int(one["walked"]), int(other["walked"]))
    return runs


NOMINAL, TUNED, HIGH_GAIN, PAPER, _, BEST = GAINS = [
    "nominal, eps 0.04",
    "nominal at its best",
    "nominal, high gain (eps 0.01)",
    "the paper's policy, eps 0.04",
    "oracle, eps 0.04: exact estimates",
    "best: identifies the robot",
]


def gains_table() -> str:
    """Courses walked in both engines."""
    lines = [[plant, *(f"{counts[name][0]}; {counts[name][1]}" for name in GAINS)] for plant, counts in gains().items()]
    return markdown_table(["", *GAINS], lines)


ENGINES = {"pybullet": "PyBullet", "mujoco": "MuJoCo"}
MASSES = [(plant, scale) for scale in ("0.5", "2", "3") for plant in ("mujoco", "pybullet")]


@cache
def mass_courses(plant: str, scale: str, who: str) -> dict[int, bool]:
    """Whether each course of the seed that `rabbit evaluate` takes was walked, by the number of the run."""
    folder = f"{plant}-{scale}-{who}"
    return {int(row["run"]): row["success"] == "True" for row in shipped("masses") if row["folder"] == folder}


def of_masses(plant: str, scale: str, parameters: str) -> int:
    """Courses walked."""
    return sum(mass_courses(plant, scale, parameters).values())


def of_twenty(scale: str, parameters: str) -> str:
    """Between how many of twenty other courses are walked in PyBullet, with a probability of 95%."""
    ends = mass_courses("pybullet", scale, parameters)
    return "{} to {}".format(*of_so_many(20, sum(ends.values()), len(ends)))


def masses_table() -> str:
    """Courses walked, with Wilson's intervals."""
    lines = []
    for plant, scale in MASSES:
        ends = [mass_courses(plant, scale, parameters) for parameters in ("best", "nominal_tuned")]
        counts = [(sum(ended.values()), len(ended)) for ended in ends]
        cells_ = ["{} ({:.2f} to {:.2f})".format(walks, *wilson(walks, runs)) for walks, runs in counts]
        lines.append([scale, ENGINES[plant], *cells_])
    return markdown_table(["mass scale", "engine", "`best`", "nominal at its best"], lines)


def lost(plant: str) -> tuple[int, int, int]:
    """Courses that `best` loses at thrice the mass: all, those that none of three walks, those walked with 300 N m."""
    ends = mass_courses(plant, "3", "best")
    runs = [run for run, is_walked in ends.items() if not is_walked]
    others = mass_courses(plant, "3", "oracle-slopes"), mass_courses(plant, "3", "nominal_tuned")
    stronger = mass_courses(plant, "3", "best-300")
    return len(runs), sum(not any(other[run] for other in others) for run in runs), sum(stronger[run] for run in runs)


def verdicts() -> dict[str, int]:
    """How many of the paper's claims have each verdict, and fall with a tuned controller; all claims, all runs."""
    every = read_rows(REPRODUCED / CLAIMS)
    counts = Counter(row["verdict"] for row in every if row["verdict"] != Verdict.OPEN)
    fallen = sum(row["verdict"] == Verdict.REPRODUCED and row["undone"] == "True" for row in every)
    runs = sum(int(row["runs"]) for row in read_rows(REPRODUCED / RUNS))
    return {**counts, "fallen": fallen, "claims": counts.total(), "all": len(every), "runs": runs}


@cache
def ridden(task: str = "") -> dict[str, list[dict[str, str]]]:
    """Rides of the tasks of one's own, by what the controller knows."""
    rides: dict[str, list[dict[str, str]]] = {"nominal": [], "learned": [], "oracle": []}
    for row in shipped("own_systems"):
        if row["folder"].startswith(task):
            rides["learned" if row["controller"].endswith(".safetensors") else row["controller"]].append(row)
    return rides


def kept(rides: Sequence[Mapping[str, str]]) -> int:
    """How many kept all barriers."""
    return sum(row["kept"] == "True" for row in rides)


def least_barrier(rides: Sequence[Mapping[str, str]]) -> float:
    """The least barrier of the rides that did not fall."""
    barriers = [float(value) for row in rides for name, value in row.items() if name not in ENDED and value]
    return round(min(filter(math.isfinite, barriers)), 4) + 0.0


def rides() -> tuple[list[int], str]:
    """Rides that kept their barriers: all, with nominal, learned and exact estimates; the least learned barrier, mm."""
    learned = ridden()["learned"]
    return [len(learned), *map(kept, ridden().values())], f"{-1000 * least_barrier(learned):.0f}"


def rides_table() -> str:
    """The same, by task."""
    lines = []
    for task, title in TASKS.items():
        lines.append([title])
        for of_one in ridden(task).values():
            text, fell = rate_text(kept(of_one), len(of_one)), sum("-inf" in row.values() for row in of_one)
            lines[-1].append(f"{text}; {least_barrier(of_one):.4f}" + f"; {fell} fall" * bool(fell))
    return markdown_table(["task", *ridden()], lines)
