"""Stones of 0.25 to 0.50 m, and further: a gait library and one-step preview, beside the single gait (ours)."""

from collections.abc import Iterable
from functools import cached_property
from typing import Any

from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from rabbit_description.gait import load_gait
from rabbit_experiments.summary import Walks
from rabbit_viewer import style

from rabbit_reproduce.controllers import IDENTIFIED, PD, Contender, variant
from rabbit_reproduce.curves import WIDTH
from rabbit_reproduce.experiment import Experiment
from rabbit_reproduce.report import Claim, Table
from rabbit_reproduce.table_lines import MAIN, Found, Line, Runs

LIBRARY, SINGLE = "wide", "stones_0350_084"
RUNS = Runs(10, 3)
BAR_SHARE = 0.3  # of steps with an active barrier row
CENTRED = {**PD, "stone_margin": 0.007}
OURS = variant("identified", "rl-cbf-clf-qp", "zero", CENTRED, IDENTIFIED)
EXACT = variant("oracle", "rl-cbf-clf-qp", "oracle", CENTRED)
UNADAPTED = variant("no estimates", "rl-cbf-clf-qp", "zero", CENTRED)
WIDE, WIDER = (0.25, 0.50), (0.20, 0.60)  # m, of l_min
SPREAD = 2.5  # std from the mean to either end
SHOWN = {  # of the figure: key, name, marker, colour
    "near edge": ("library, barriers on", "o", style.BLUE),
    "near edge, off": ("library, barriers off", "x", style.RED),
    "single": ("single gait, barriers on", "^", style.ORANGE),
}


class WideStones(Experiment):
    """Aimed at the near edge of each stone, so that the barriers have to act, and at its middle."""

    name = "wide-stones"
    shown = tuple(SHOWN)

    @cached_property
    def by_key(self) -> dict[Any, Line]:
        near: dict[str, Any] = {"gait": LIBRARY, "stone_aim": 0.0}
        middle: dict[str, Any] = {"gait": LIBRARY, "stone_aim": 0.5}
        single, off = {"gait": SINGLE}, {"barrier_rows": False}
        return {
            "near edge": _line("library, near edge, barriers on", OURS, near),
            "near edge, off": _line("library, near edge, barriers off", OURS, near | off),
            "middle": _line("library, middle, barriers on", OURS, middle),
            "middle, off": _line("library, middle, barriers off", OURS, middle | off),
            "single": _line("single gait, barriers on", OURS, single),
            "single, off": _line("single gait, barriers off", OURS, single | off),
            "oracle": _line("library, near edge, barriers on, oracle", EXACT, near),
            "no estimates": _line("library, near edge, barriers on, no estimates", UNADAPTED, near),
            "wider": _line("library, near edge, barriers on, l_min 0.20 to 0.60 m", OURS, near, WIDER),
            "wider, middle": _line("library, middle, barriers on, l_min 0.20 to 0.60 m", OURS, middle, WIDER),
        }

    def compared(self) -> Iterable[Line]:
        """None: it was tuned on other gaits."""
        return ()

    def tables(self, found: Found) -> tuple[Table, ...]:
        """Active barriers by line, then the usual ones."""
        columns = ("what", "walked, mean stones", "steps with a barrier active", "worst margin (mm)")
        rows = []
        for line in self.lines():
            walks = found.walks(line)
            margin = min(row.worst_margin for row in walks.rows)
            rows.append((line.what, walks.text, f"{active_share(walks):.0%}", f"{1e3 * margin:.1f}"))
        return Table(name="barriers", columns=columns, rows=tuple(rows)), *super().tables(found)

    def claims(self, found: Found) -> list[Claim]:
        """Ours, so without a verdict on the paper."""
        walks = self.walks(found)
        on, off, single = walks["near edge"], walks["near edge, off"], walks["single"]
        holds = on.passes and active_share(on) >= BAR_SHARE and not off.passes and not single.passes
        ours = f"{on.text}, active in {active_share(on):.0%} of steps; off {off.text}; single gait {single.text}"
        return [self.claim("walks", ours, who=OURS.title, holds="so it is" if holds else "not so")]

    def figures(self, found: Found) -> dict[str, tuple[str, Figure]]:
        figure, (axes,) = style.figure(1, height=2.8, width=WIDTH)
        walks = {key: found.records(self.by_key[key]) for key in SHOWN}
        index, near, far = walks["near edge"].landings[:, [0, 3, 4]].T
        axes.bar(index, far - near, 0.8, bottom=near, color=style.STONE, alpha=0.5, label="stone")
        for key, (name, marker, colour) in SHOWN.items():
            index, l = walks[key].landings[:, 0], walks[key].landings[:, 2]  # noqa: E741
            axes.plot(index, l, marker, color=colour, label=name, markersize=5, fillstyle="none", linestyle="none")
        style.limit(axes, load_gait(SINGLE).step_length, "single gait's step length")
        axes.set(xlabel="stone", ylabel="$l$ from the stance foot (m)", ylim=(0.2, 0.6))
        axes.xaxis.set_major_locator(MaxNLocator(integer=True))
        style.legend(axes, columns=3)
        return {"landings": (self.caption, figure)}


def active_share(walks: Walks) -> float:
    """Share of all steps in which B1 or B2 held with equality at some tick."""
    return walks.total("barrier_active_steps") / max(walks.total("steps"), 1)


def _line(what: str, contender: Contender, tuning: dict[str, Any], reach: tuple[float, float] = WIDE) -> Line:
    low, high = reach
    course = {
        "l_min_distribution": "uniform",
        "l_min_mean": round((low + high) / 2, 6),
        "l_min_std": round((high - low) / 2 / SPREAD, 6),
        "l_min_truncation": SPREAD,
    }
    return Line(what, contender.assembly(tuning, mass_scale=2.0, **course), runs=RUNS, columns=(MAIN,))
