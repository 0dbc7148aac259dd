"""How often the QP has no answer without slack, by the number of episodes that its estimates have learned from."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from rabbit_experiments.assembly import Assembly
from rabbit_experiments.conditions import TRAINING_SCALE
from rabbit_experiments.evaluation import SeededRun, episode_seeds
from rabbit_viewer import style

from rabbit_reproduce.controllers import CBF_CLF, CBF_CLF_ORACLE, RL_CBF_CLF
from rabbit_reproduce.curves import WIDTH
from rabbit_reproduce.experiment import Experiment
from rabbit_reproduce.feasibility import Feasibility, JudgedWalk, RowSet, share
from rabbit_reproduce.recipes import Recipe
from rabbit_reproduce.report import Cell, Claim, Table, judge
from rabbit_reproduce.table_lines import Found, Size
from rabbit_reproduce.training import Trained, recipes

EPISODES = (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 18)
WALKERS = (CBF_CLF, RL_CBF_CLF, CBF_CLF_ORACLE)  # whose walks are the common states
STEPS = 5  # a walk
GAIN = 0.5  # of the nominal controller's share, at most
FEW = 4  # of the episodes, the first and the last ones
SETS: dict[RowSet, str] = {"safety": "safety rows", "all": "with CLF"}
CAPTION = (
    "Share of common states whose hard QP a linear programme proves infeasible, by the number of episodes that the "
    "policy has learned from; lines are means over training seeds, bands their range; scale 2, stones. The states are "
    "those of walks of the nominal controller, of the last policy of seed 1 and of the oracle."
)


class FeasibilityByEpisode(Experiment):
    """Policies of successive episodes, judged on the same states."""

    name = "feasibility-by-episode"
    title = "Feasibility of the hard QP by training episode"
    label = "sec:discussion"
    paper = "With learned terms one can gradually enhance the quadratic program's feasibility."
    why = (
        "What is learned is the true rows, and they are infeasible more often than the nominal ones, which have an "
        "answer nearly everywhere, a wrong one. Within five episodes the learned rows leave the nominal share and come "
        "near the true one."
    )
    needs_training = True

    def trainings(self, size: Size) -> list[Recipe]:
        """Those of the stepping stones' problem."""
        return _on_stones(recipes(size.quick))

    def jobs(self, size: Size) -> list[SeededRun]:
        """None without trainings."""
        if not size.trained:
            return []
        plant: dict[str, Any] = {"mass_scale": TRAINING_SCALE, "stones": STEPS}
        own = [each.assembly(**plant) for each in (CBF_CLF, CBF_CLF_ORACLE)]
        judges = tuple(map(size.own, [*own, *_judges(size.trained)]))
        walkers = [size.own(each.assembly(**plant)) for each in WALKERS]
        seeds = episode_seeds(size.seed, 1 if size.quick else 3).values()
        return [JudgedWalk(walker, seed, judges, title=self.name) for walker in walkers for seed in seeds]

    def tables(self, found: Found) -> Sequence[Table]:
        columns = (
            "rows of",
            *(f"{SETS[rows]}, seed {recipe.parameters.seed}" for rows in SETS for recipe in _recipes(found)),
        )
        baselines = [
            (each.title, *(f"{self._share(found, i, rows):.2%}" for rows in SETS for _ in _recipes(found)))
            for i, each in enumerate((CBF_CLF, CBF_CLF_ORACLE))
        ]
        curves = {rows: self._curves(found, rows) for rows in SETS}
        rows_: list[tuple[Cell, ...]] = [
            (f"policy after episode {episode}", *(f"{row[i]:.2%}" for rows in SETS for row in curves[rows].values()))
            for i, episode in enumerate(EPISODES)
        ]
        return (Table(name="shares", columns=columns, rows=(*baselines, *rows_)),)

    def figures(self, found: Found) -> dict[str, tuple[str, Figure]]:
        curves = {rows: np.array(list(self._curves(found, rows).values())) for rows in SETS}
        beside = {rows: (self._share(found, 0, rows), self._share(found, 1, rows)) for rows in SETS}
        return {"feasibility_by_episode": (CAPTION, _figure(curves, beside))}

    def claims(self, found: Found) -> Sequence[Claim]:
        """Of the safety rows, of all; and whether the learned rows are at last infeasible as often as the true ones."""
        return [*(self._claim(found, rows) for rows in SETS), self._as_true(found)]

    def _claim(self, found: Found, rows: RowSet) -> Claim:
        table = np.array(list(self._curves(found, rows).values()))
        nominal, oracle = (self._share(found, i, rows) for i in range(2))
        mean = table.mean(axis=0)
        parts = {
            "at last less than nominal": mean[-1] <= GAIN * nominal and nominal > 0,
            "later less than earlier": mean[-FEW:].mean() < mean[:FEW].mean(),
        }
        return Claim(
            claim=f"learning makes the hard QP feasible more often, {SETS[rows]}, on common states",
            paper="gradually enhances feasibility",
            ours=f"infeasible: {mean[0]:.2%} after episode {EPISODES[0]}, {mean[-1]:.2%} after {EPISODES[-1]}; nominal "
            f"{nominal:.2%}, oracle {oracle:.2%}",
            verdict=judge(parts),
        )

    def _as_true(self, found: Found) -> Claim:
        """A wrong model's rows may well be feasible where the true ones are not."""
        ends = {rows: np.array(list(self._curves(found, rows).values()))[:, [0, -1]].mean(axis=0) for rows in SETS}
        text = (
            f"{name}: {ends[rows][0]:.2%}, then {ends[rows][1]:.2%}, true rows {self._share(found, 1, rows):.2%}"
            for rows, name in SETS.items()
        )
        return Claim(
            claim="the share of infeasible ticks comes to that of the true rows (oracle)",
            ours="; ".join(text),
        )

    def _walks(self, found: Found) -> list[list[Feasibility]]:
        return [[found.result(job) for job in self.jobs(found.size)]]

    def _share(self, found: Found, judge_: int, rows: RowSet) -> float:
        return share(self._walks(found), judge_, rows)

    def _curves(self, found: Found, rows: RowSet) -> Mapping[Recipe, list[float]]:
        """Shares over `EPISODES` of each training."""
        walks, n = self._walks(found), len(EPISODES)
        return {
            recipe: [share(walks, 2 + n * i + j, rows) for j in range(n)] for i, recipe in enumerate(_recipes(found))
        }


def _recipes(found: Found) -> list[Recipe]:
    return _on_stones(found.size.trained.recipes) if found.size.trained else []


def _on_stones(trainings: Sequence[Recipe]) -> list[Recipe]:
    """Those of the stepping stones' problem at scale 2."""
    own = [recipe for recipe in trainings if recipe.parameters.problem.name == RL_CBF_CLF.controller]
    return [recipe for recipe in own if recipe.mass_scale == TRAINING_SCALE]


def _judges(trained: Trained) -> list[Assembly]:
    """Policies of each training after each of `EPISODES`."""
    plant: dict[str, Any] = {"mass_scale": TRAINING_SCALE, "stones": STEPS}
    return [
        RL_CBF_CLF.with_policy(str(trained.policy(recipe, episode))).assembly(**plant)
        for recipe in _on_stones(trained.recipes)
        for episode in EPISODES
    ]


def _figure(curves: Mapping[RowSet, Any], beside: Mapping[RowSet, tuple[float, float]]) -> Figure:
    """A panel for each set of rows."""
    figure, panels = style.figure(len(SETS), height=1.9, width=WIDTH)
    for axes, (rows, table) in zip(panels, curves.items(), strict=True):
        percent = 100 * table
        axes.plot(EPISODES, percent.mean(axis=0), "o-", color=style.BLUE, markersize=4, label=RL_CBF_CLF.title)
        low, high = percent.min(axis=0), percent.max(axis=0)
        axes.fill_between(EPISODES, low, high, color=style.BLUE, alpha=0.18, linewidth=0)
        for contender, value in zip((CBF_CLF, CBF_CLF_ORACLE), beside[rows], strict=True):
            axes.axhline(100 * value, color=contender.colour, linestyle=contender.line, label=contender.title)
        top = axes.dataLim.y1
        axes.set(ylabel=f"infeasible (%),\n{SETS[rows]}", ylim=(-0.04 * top, 1.08 * top))
    panels[-1].set_xlabel("training episodes")
    panels[-1].xaxis.set_major_locator(MaxNLocator(integer=True))
    style.legend(panels[0], columns=3)
    figure.align_ylabels()
    return figure
