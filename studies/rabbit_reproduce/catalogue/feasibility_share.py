"""How often the QP has no answer without slack, by a linear programme (Discussion)."""

from collections.abc import Sequence

from rabbit_experiments.evaluation import SeededRun, episode_seeds

from rabbit_reproduce.controllers import (
    CBF_CLF,
    CBF_CLF_ORACLE,
    CLF,
    CLF_ORACLE,
    RL_CBF_CLF,
    RL_CLF,
    ROBUST,
    Contender,
)
from rabbit_reproduce.experiment import Experiment
from rabbit_reproduce.feasibility import Feasibility, JudgedWalk, RowSet, share, share_text, total
from rabbit_reproduce.report import Cell, Claim, Table, judge
from rabbit_reproduce.table_lines import COLUMNS, Column, Found, Size

GROUPS = {"stones": (RL_CBF_CLF, CBF_CLF, ROBUST, CBF_CLF_ORACLE), "flat": (RL_CLF, CLF, CLF_ORACLE)}
STEPS = 10  # a walk
DRASTIC = 0.5  # of the nominal controller's share, at most


class FeasibilityShare(Experiment):
    """Each controller walks; every controller's rows are judged at each of its ticks."""

    name = "feasibility"
    title = "Ticks whose hard QP is infeasible, scale 2"
    label = "sec:discussion"
    paper = "With the trained RL-CBF-CLF-QP the feasibility drastically improves compared to the nominal CBF-CLF-QP."
    why = (
        "The nominal rows have an answer at nearly every tick, of its own walks as well: it falls because they "
        "are false. The true rows have none in some, and learned ones come to be like them "
        "(feasibility-by-episode)."
    )

    judged_on_rigid = True

    def jobs(self, size: Size) -> list[SeededRun]:
        return [
            job
            for group in GROUPS
            for column in size.columns(COLUMNS)
            for jobs in self._jobs(size, group, column)
            for job in jobs
        ]

    def tables(self, found: Found) -> Sequence[Table]:
        heads = (
            *("terrain", "plant", "rows of", "safety rows, own path", "safety rows, common states"),
            *("with CLF, own path", "with CLF, common states", "ticks of own path, of all"),
        )
        rows = [
            self._row(found, group, column, judge_)
            for group, members in GROUPS.items()
            for column in found.size.columns(COLUMNS)
            for judge_ in range(len(members))
        ]
        return (Table(name="shares", columns=heads, rows=tuple(rows)),)

    def claims(self, found: Found) -> Sequence[Claim]:
        """On stones."""
        learned, nominal = range(2)
        walks = self._walks(found, "stones", found.column)
        own = [share([walks[who]], who, "safety") for who in (learned, nominal)]
        common = [share(walks, who, "safety") for who in (learned, nominal)]
        parts = {
            "less on its own path": own[learned] <= DRASTIC * own[nominal] and own[nominal] > 0,
            "less on common states": common[learned] <= DRASTIC * common[nominal] and common[nominal] > 0,
        }
        return [
            Claim(
                claim="RL-CBF-CLF-QP's hard QP is infeasible in at most half as many ticks as the nominal one's",
                paper="drastically improves",
                ours=f"own path {own[learned]:.2%} against {own[nominal]:.2%}; "
                f"common states {common[learned]:.2%} against {common[nominal]:.2%}",
                verdict=judge(parts),
            )
        ]

    def _jobs(self, size: Size, group: str, column: Column) -> list[list[SeededRun]]:
        """Jobs of each walker of a group."""
        plant = {"mass_scale": 2.0, "stones": STEPS, "plant": column.plant, "motor_lag": column.lag}
        assemblies = tuple(size.own(each.assembly(**plant)) for each in GROUPS[group])
        seeds = episode_seeds(size.seed, max(1, size.runs // 2)).values()
        return [
            [JudgedWalk(assembly, seed, assemblies, title=f"feasibility, {size.title(column)}") for seed in seeds]
            for assembly in assemblies
        ]

    def _walks(self, found: Found, group: str, column: Column) -> list[list[Feasibility]]:
        """Results of each walker's runs."""
        return [[found.result(job) for job in jobs] for jobs in self._jobs(found.size, group, column)]

    def _row(self, found: Found, group: str, column: Column, who: int) -> tuple[Cell, ...]:
        walks = self._walks(found, group, column)
        contender: Contender = GROUPS[group][who]
        sets: tuple[RowSet, ...] = ("safety", "all") if group == "stones" else ("all",)
        cells: dict[RowSet, tuple[str, str]] = {
            rows: (share_text([walks[who]], who, rows), share_text(walks, who, rows)) for rows in sets
        }
        ticks = f"{total([walks[who]])}, {total(walks)}"
        safety = cells.get("safety", ("-", "-"))
        return (group, found.size.title(column), contender.title, *safety, *cells["all"], ticks)
