"""Figures and tables of pages, worked out from the shipped tables: `shipped_figures.py` says where they stand."""

import csv
import math
import re
from collections import Counter
from collections.abc import Sequence
from functools import cache, partial

from common import ROOT
from rabbit_benchmark.cells import TERRAINS, Map, cells
from rabbit_benchmark.comparison import holm, of_so_many
from rabbit_benchmark.table import Table
from rabbit_experiments.summary import wilson
from rabbit_experiments.tables import markdown_table
from rabbit_reproduce.report import CLAIMS, RUNS, Verdict, read_rows

DATA = ROOT / "studies" / "docs" / "data"
REPRODUCED = ROOT / "studies" / "docs" / "reproduced"
METHODS = {  # of the large table, as it calls them
    "nominal": "nominal, mu'mu",
    "nominal-pd": "nominal, PD-centred",
    "nominal-tuned": "nominal at its best",
    "robust": "robust, mu'mu",
    "l1": "L1, mu'mu",
    "pd": "PD on the gait library",
    "paper": "the paper's policy (DDPG)",
    "regression": "the same estimates by regression",
    "gp-socp": "GP-CBF-CLF-SOCP",
    "ppo": "PPO, joint targets",
    "sac": "SAC, joint targets",
    "dagger": "DAgger, joint targets",
    "identified": "identified, PD-centred",
    "best-nominal": "`best`, not identified",
    "best-unlearned": "`best`, a rule instead of the learned model",
    "best-before": "`best`, without care",
    "mixture": "`mixture`: `best` with a quarter of DAgger",
    "best": "**`best`**",
    "oracle": "oracle",
    "oracle-slopes": "oracle, gaits for slopes",
}
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
def table(name: str) -> Table:
    """A shipped one."""
    return Table.read(DATA / f"{name}.csv")


def where(*maps: Map, terrains: Sequence[str] = TERRAINS) -> list[str]:
    """The cells of some maps."""
    return [cell.name for cell in cells().values() if cell.map in maps and cell.terrain in terrains]


def on_both(name: str) -> list[str]:
    """A family's cells, on stones and on flat ground."""
    return [cell for terrain in TERRAINS if (cell := f"{terrain}/{name}") in cells()]


STONES: Sequence[str] = ("stones",)
FLAT: Sequence[str] = ("flat",)


def walked(name: str, method: str, *maps: Map, terrains: Sequence[str] = TERRAINS) -> int:
    """Courses that a method walked there."""
    return table(name).walked(method, where(*maps, terrains=terrains))


def courses(name: str, *maps: Map, terrains: Sequence[str] = TERRAINS) -> int:
    """All courses there."""
    return table(name).courses("best", where(*maps, terrains=terrains))


large, unseen, harm = (partial(walked, name) for name in ("benchmark_mujoco", "unseen_mujoco", "no_harm_mujoco"))


def interval(name: str, this: str, other: str, *maps: Map, terrains: Sequence[str] = TERRAINS) -> list[str]:
    """Of a hundred courses, how many more one walks than another, and its 95% interval; `#` as on a page."""
    pair = table(name).paired(this, other, where(*maps, terrains=terrains))
    if pair:
        return [signed(each) for each in pair.difference]
    one, two = (walked(name, each, *maps, terrains=terrains) for each in (this, other))
    return [signed((one - two) / courses(name, *maps, terrains=terrains)), "#", "#"]


def points(name: str, this: str, other: str, *maps: Map, terrains: Sequence[str] = TERRAINS) -> str:
    """The same, as in `+11 (+6 to +15)`."""
    return "{} ({} to {})".format(*interval(name, this, other, *maps, terrains=terrains))


def signed(share: float, digits: int = 0) -> str:
    """Of a hundred, a half away from 0."""
    value = math.copysign(math.floor(abs(share) * 100 * 10**digits + 0.5 + 1e-9) / 10**digits, share)
    return f"{value:+.{digits}f}" if value else "0"


def unpaired(one: int, other: int, runs: int) -> list[str]:
    """The 95% interval of the difference of two shares of as many courses, by Wald."""
    shares = one / runs, other / runs
    half = 1.96 * math.sqrt(sum(each * (1 - each) / runs for each in shares))
    return [signed(shares[0] - shares[1] + each, 1) for each in (-half, half)]


def p_values(name: str, reference: str) -> dict[str, float]:
    """McNemar's with Holm's correction, by method; empty where a row does not say how each course ended."""
    others = [each for each in METHODS if each != reference]
    pairs = [table(name).paired(each, reference, where(*MAPS)) for each in others]
    known = [pair.p_value for pair in pairs if pair]
    return dict(zip(others, holm(known), strict=True)) if len(known) == len(pairs) else {}


def large_table() -> str:
    """Courses walked by each method on each map."""
    head, lines = ["method"], []
    for terrain in TERRAINS:
        for number, each in enumerate(MAPS):
            size = courses("benchmark_mujoco", each, terrains=(terrain,))
            is_new = each in ("inside", "outside") or (each == "storm")
            head.append(("" if number else f"{terrain}: ") + each + (f", of {size}" if is_new else ""))
    every = courses("benchmark_mujoco", *MAPS)
    for method, title in METHODS.items():
        line = []
        for terrain in TERRAINS:
            there = [where(each, terrains=(terrain,)) for each in MAPS]
            walks = (method, there[0][0]) in table("benchmark_mujoco").rows
            line += [str(table("benchmark_mujoco").walked(method, each)) if walks else "" for each in there]
        lines.append([title, *line, f"{large(method, *MAPS):,}" if all(line) else ""])
    return markdown_table([*head, f"all, of {every:,}"], lines)


def unseen_table() -> str:
    """Courses walked of each unseen family."""
    lines = [
        [f"`{each}`", *(str(table("unseen_mujoco").walked(one, [each])) for one in UNSEEN)] for each in where("unseen")
    ]
    return markdown_table(["family, of 40, MuJoCo", *UNSEEN.values()], lines)


Runs = dict[str, dict[str, tuple[int, int]]]


@cache
def gains() -> Runs:
    """Courses of 20 walked in PyBullet and in MuJoCo, by mass or payload, then by controller."""
    found: Runs = {}
    rows = [row for row in read_rows(REPRODUCED / RUNS) if row["experiment"] == "higher-gain"]
    for one, other in zip(rows[::2], rows[1::2], strict=True):
        what, _, value = one["what"].rpartition(": ")
        name, _, plant = what.rpartition(", ")
        title = f"mass scale {value}" if plant.startswith("mass") else f"{value} kg"
        if title != "0 kg":  # which is mass scale 1
            found.setdefault(title, {})[name] = (int(one["walked"]), int(other["walked"]))
    return found


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
    lines = [[plant, *(f"{each[name][0]}; {each[name][1]}" for name in GAINS)] for plant, each in gains().items()]
    return markdown_table(["", *GAINS], lines)


ENGINES = {"pybullet": "PyBullet", "mujoco": "MuJoCo"}
MASSES = [(plant, scale) for scale in ("0.5", "2", "3") for plant in ("mujoco", "pybullet")]


@cache
def mass_courses(plant: str, scale: str, parameters: str, torque_limit: str = "200") -> dict[int, bool]:
    """Whether each course of the seed that `rabbit evaluate` takes was walked, by the number of the run."""
    asked = {"plant": plant, "mass_scale": scale, "parameters": parameters, "torque_limit": torque_limit}
    with (DATA / "mass_courses.csv").open(encoding="utf-8", newline="") as file:
        (row,) = (row for row in csv.DictReader(file) if asked.items() <= row.items())
    runs = map(int, row["runs"].split()) if row["runs"] else range(len(row["by_course"]))
    return {run: end == "w" for run, end in zip(runs, row["by_course"], strict=True)}


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
        counts = [(sum(each.values()), len(each)) for each in ends]
        cells_ = ["{} ({:.2f} to {:.2f})".format(walks, *wilson(walks, runs)) for walks, runs in counts]
        lines.append([scale, ENGINES[plant], *cells_])
    return markdown_table(["mass scale", "engine", "`best`", "nominal at its best"], lines)


def lost(plant: str) -> tuple[int, int, int]:
    """Courses that `best` loses at thrice the mass: all, those that none of three walks, those walked with 300 N m."""
    ends = mass_courses(plant, "3", "best")
    runs = [run for run, is_walked in ends.items() if not is_walked]
    others = mass_courses(plant, "3", "oracle-slopes"), mass_courses(plant, "3", "nominal_tuned")
    stronger = mass_courses(plant, "3", "best", "300")
    return len(runs), sum(not any(each[run] for each in others) for run in runs), sum(stronger[run] for run in runs)


def verdicts() -> dict[str, int]:
    """How many of the paper's claims have each verdict, and fall with a tuned controller; all claims, all runs."""
    every = read_rows(REPRODUCED / CLAIMS)
    counts = Counter(row["verdict"] for row in every if row["verdict"] != Verdict.OPEN)
    fallen = sum(row["verdict"] == Verdict.REPRODUCED and row["undone"] == "True" for row in every)
    runs = sum(int(row["runs"]) for row in read_rows(REPRODUCED / RUNS))
    return {**counts, "fallen": fallen, "claims": counts.total(), "all": len(every), "runs": runs}


def rides() -> tuple[list[int], str]:
    """Rides that kept their barriers: all, with nominal, learned and exact estimates; the least learned barrier, mm."""
    text = (ROOT / "studies" / "docs" / "results_robots.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (?:cart-pole|Segway|arm) \(.*", text, re.MULTILINE)[:3]
    kept = [
        [re.search(r"(\d+) of (\d+)(?: \(.*?\))?; (-?[\d.]+)", cell) for cell in row.split("|")[2:5]] for row in rows
    ]
    counts = [sum(int(cell[1]) for cell in column if cell) for column in zip(*kept, strict=True)]
    every = sum(int(cell[2]) for cell, *_ in kept if cell)
    return [every, *counts], f"{1000 * max(-float(cell[3]) for _, cell, _ in kept if cell):g}"
