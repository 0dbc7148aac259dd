"""Has the hard QP an answer, and is the nominal CLF one of the true plant [sec:discussion], [Approach2]?

At each tick of each walk a linear programme decides whether the rows of a judge, a controller with its own estimates,
can be met without slack (`rabbit_reproduce.feasibility`).
"""

from abc import abstractmethod
from collections.abc import Hashable, Iterable, Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from rabbit_experiments.conditions import TRAINING_SCALE
from rabbit_experiments.evaluation import SeededRun, episode_seeds
from rabbit_viewer import style

from rabbit_reproduce.controllers import CBF_CLF, CBF_CLF_ORACLE, CLF, CLF_ORACLE, RL_CBF_CLF, RL_CLF, ROBUST, Contender
from rabbit_reproduce.experiment import Experiment
from rabbit_reproduce.feasibility import Feasibility, JudgedWalk, RowSet, share, share_text, total
from rabbit_reproduce.report import Cell, Claim, Table
from rabbit_reproduce.table_lines import COLUMNS, SEED, Column, Results, Size
from rabbit_reproduce.training import TrainingJob, recipes

WALKERS = (CBF_CLF, RL_CBF_CLF, CBF_CLF_ORACLE)  # whose walks are the common states
SHORT, STEPS = 5, 10  # a walk
Case = Hashable


class Judged(Experiment):
    """Walks by case, each judged by all judges of its case."""

    @abstractmethod
    def cases(self, size: Size) -> Iterable[Case]:
        """The cases of which there are walks."""

    @abstractmethod
    def walks_of(self, size: Size, case: Any) -> list[list[JudgedWalk]]:
        """The runs of each walker of a case."""

    def jobs(self, size: Size) -> list[SeededRun]:
        return [job for case in self.cases(size) for runs in self.walks_of(size, case) for job in runs]

    def judged(self, results: Results, case: Case) -> list[list[Feasibility]]:
        """Results of each walker's runs."""
        return [[results.result(job) for job in runs] for runs in self.walks_of(results.size, case)]


PLANTS: dict[str, dict[str, Any]] = {
    **{f"scale {scale:g}": {"mass_scale": scale} for scale in (0.5, 0.7, 1.0, 2.0, 3.0)},
    **{f"payload {load:g} kg": {"payload": load} for load in (32.0, 72.0)},
}
ROWS: dict[str, dict[str, bool]] = {  # of the true plant, saturation in all
    "CLF row": {"barrier_rows": False, "force_rows": False},
    "CLF row and ground forces": {"barrier_rows": False},
    "and barriers": {},
}
NEARLY_ALL = 0.99  # of the states


class ClfAssumption(Judged):
    """Is there a torque within the motors' limits that meets the true CLF row, V-dot <= -lambda / eps V with the true
    V-dot, alone and together with the true ground forces and barriers? At the states of several controllers' walks."""

    name = "clf-assumption"

    def cases(self, size: Size) -> Iterable[Case]:
        return PLANTS

    def walks_of(self, size: Size, case: str) -> list[list[JudgedWalk]]:
        plant: dict[str, Any] = {**PLANTS[case], "stones": SHORT}
        judges = tuple(size.own(CBF_CLF_ORACLE.assembly(rows, **plant)) for rows in ROWS.values())
        return _walks(size, WALKERS, judges, 1 if size.quick else 3, f"{self.name}, {case}", plant)

    def tables(self, results: Results) -> Sequence[Table]:
        columns = ("plant", *ROWS, *(f"CLF row, {contender.title}'s states" for contender in WALKERS), "states")
        rows: list[Sequence[Cell]] = []
        for name in PLANTS:
            walks = self.judged(results, name)
            by_walker = [f"{1 - share([runs], 0, 'all'):.1%}" for runs in walks]
            met = [f"{value:.1%}" for value in self._met(results, name).values()]
            rows.append((name, *met, *by_walker, total(walks)))
        return (Table("shares", columns, tuple(rows)),)

    def claims(self, results: Results) -> list[Claim]:
        """Where the paper's method works, and where it does not."""
        shares = {name: self._met(results, name) for name in PLANTS}
        ours = {name: ", ".join(f"{rows} {value:.1%}" for rows, value in met.items()) for name, met in shares.items()}
        twice, half = (shares[f"scale {scale}"]["CLF row"] for scale in ("2", "0.5"))
        return [
            self.claim("holds", ours["scale 2"], {"in 99% of the states": twice >= NEARLY_ALL}),
            self.claim("fails", ours["scale 0.5"], {"in less than 99% of the states": half < NEARLY_ALL}),
            self.claim("loaded", ours["payload 72 kg"]),
        ]

    def _met(self, results: Results, name: str) -> dict[str, float]:
        """Share of all states in which the rows can be met."""
        walks = self.judged(results, name)
        return {rows: 1 - share(walks, i, "all") for i, rows in enumerate(ROWS)}


GROUPS = {"stones": (RL_CBF_CLF, CBF_CLF, ROBUST, CBF_CLF_ORACLE), "flat": (RL_CLF, CLF, CLF_ORACLE)}
DRASTIC = 0.5  # of the nominal controller's share, at most


class FeasibilityShare(Judged):
    """Each controller walks; every controller's rows are judged at each of its ticks."""

    name = "feasibility"

    def cases(self, size: Size) -> list[tuple[str, Column]]:
        return [(group, column) for group in GROUPS for column in size.columns(COLUMNS)]

    def walks_of(self, size: Size, case: tuple[str, Column]) -> list[list[JudgedWalk]]:
        group, column = case
        plant = {"mass_scale": 2.0, "stones": STEPS, "plant": column.plant, "motor_lag": column.lag}
        judges = tuple(size.own(contender.assembly(**plant)) for contender in GROUPS[group])
        return _walks(size, GROUPS[group], judges, max(1, size.runs // 2), f"feasibility, {size.title(column)}", plant)

    def tables(self, results: Results) -> Sequence[Table]:
        heads = (
            *("terrain", "plant", "rows of", "safety rows, own path", "safety rows, common states"),
            *("with CLF, own path", "with CLF, common states", "ticks of own path, of all"),
        )
        rows = []
        for group, column in self.cases(results.size):
            walks = self.judged(results, (group, column))
            for who, contender in enumerate(GROUPS[group]):
                own = [walks[who]]
                safety, every = ((share_text(own, who, rows), share_text(walks, who, rows)) for rows in SETS)
                safety = safety if group == "stones" else ("-", "-")
                ticks = f"{total(own)}, {total(walks)}"
                rows.append((group, results.size.title(column), contender.title, *safety, *every, ticks))
        return (Table("shares", heads, tuple(rows)),)

    def claims(self, results: Results) -> list[Claim]:
        """Claims on stones, about RL-CBF-CLF-QP and the nominal controller."""
        walks = self.judged(results, ("stones", results.column))
        own, own_nominal = (share([walks[who]], who, "safety") for who in range(2))
        common, common_nominal = (share(walks, who, "safety") for who in range(2))
        parts = {
            "less on its own path": own <= DRASTIC * own_nominal and own_nominal > 0,
            "less on common states": common <= DRASTIC * common_nominal and common_nominal > 0,
        }
        ours = f"own path {own:.2%} against {own_nominal:.2%}; common states {common:.2%} against {common_nominal:.2%}"
        return [self.claim("share", ours, parts)]


EPISODES = (1, 2, 3, 4, 5, 6, 8, 10, 12, 15, 18)
GAIN = 0.5  # of the nominal controller's share, at most
FEW = 4  # of the episodes, the first and the last ones
SETS: dict[RowSet, str] = {"safety": "safety rows", "all": "with CLF"}


class FeasibilityByEpisode(Judged):
    """Policies of successive episodes, judged on the same states."""

    name = "feasibility-by-episode"

    def trainings(self, size: Size) -> list[TrainingJob]:
        """The trainings of the stepping stones' problem."""
        return _on_stones(recipes(size.quick))

    def cases(self, size: Size) -> Iterable[Case]:
        """The cases; none without trainings."""
        return ["common"] if size.trained else []

    def walks_of(self, size: Size, case: Case) -> list[list[JudgedWalk]]:
        """Judges: the nominal controller, the oracle, and each training's policies after each of `EPISODES`."""
        assert size.trained
        plant: dict[str, Any] = {"mass_scale": TRAINING_SCALE, "stones": SHORT}
        trainings = _on_stones([*size.trained.made])
        files = [size.trained.policy(training, after) for training in trainings for after in EPISODES]
        who = [CBF_CLF, CBF_CLF_ORACLE, *(RL_CBF_CLF.with_policy(str(file)) for file in files)]
        judges = tuple(size.own(contender.assembly(**plant)) for contender in who)
        return _walks(size, WALKERS, judges, 1 if size.quick else 3, self.name, plant)

    def tables(self, results: Results) -> Sequence[Table]:
        curves, beside, own = self._curves(results), self._beside(results), _trained(results)
        columns = ("rows of", *(f"{SETS[rows]}, seed {recipe.parameters.seed}" for rows in SETS for recipe in own))
        lines = {
            contender.title: [beside[rows][i] for rows in SETS for _ in own]
            for i, contender in enumerate((CBF_CLF, CBF_CLF_ORACLE))
        }
        for i, episode in enumerate(EPISODES):
            lines[f"policy after episode {episode}"] = [row[i] for rows in SETS for row in curves[rows]]
        rows = tuple((title, *(f"{value:.2%}" for value in values)) for title, values in lines.items())
        return (Table("shares", columns, rows),)

    def figures(self, results: Results) -> dict[str, Figure]:
        """A panel for each set of rows."""
        curves, beside = self._curves(results), self._beside(results)
        figure, panels = style.figure(len(SETS), height=1.9)
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
        return {"feasibility_by_episode": figure}

    def claims(self, results: Results) -> list[Claim]:
        """Claims about the safety rows, about all rows, and whether those learned last fail as often as the true ones.

        A wrong model's rows may well be feasible where the true ones are not.
        """
        beside = self._beside(results)
        means = {rows: table.mean(axis=0) for rows, table in self._curves(results).items()}
        text = (
            f"{name}: {means[rows][0]:.2%}, then {means[rows][-1]:.2%}, true rows {beside[rows][1]:.2%}"
            for rows, name in SETS.items()
        )
        return [
            *(self._claim(name, means[rows], *beside[rows]) for rows, name in SETS.items()),
            self.claim("true rows", "; ".join(text)),
        ]

    def _claim(self, name: str, mean: Any, nominal: float, oracle: float) -> Claim:
        parts = {
            "at last less than nominal": bool(mean[-1] <= GAIN * nominal and nominal > 0),
            "later less than earlier": bool(mean[-FEW:].mean() < mean[:FEW].mean()),
        }
        ours = (
            f"infeasible: {mean[0]:.2%} after episode {EPISODES[0]}, {mean[-1]:.2%} after {EPISODES[-1]}; nominal "
            f"{nominal:.2%}, oracle {oracle:.2%}"
        )
        return self.claim("learning", ours, parts, rows=name)

    def _beside(self, results: Results) -> dict[RowSet, tuple[float, float]]:
        """The shares of the nominal controller and of the oracle."""
        walks = self.judged(results, "common")
        return {rows: (share(walks, 0, rows), share(walks, 1, rows)) for rows in SETS}

    def _curves(self, results: Results) -> dict[RowSet, Any]:
        """The curve of each training over `EPISODES`, (trainings, episodes)."""
        walks, n = self.judged(results, "common"), len(EPISODES)
        return {
            rows: np.array(
                [[share(walks, 2 + n * i + j, rows) for j in range(n)] for i in range(len(_trained(results)))]
            )
            for rows in SETS
        }


def _walks(
    size: Size, walkers: Sequence[Contender], judges: tuple[Any, ...], runs: int, title: str, plant: dict[str, Any]
) -> list[list[JudgedWalk]]:
    """So many runs of each walker."""
    seeds = episode_seeds(SEED, runs).values()
    assemblies = [size.own(contender.assembly(**plant)) for contender in walkers]
    return [[JudgedWalk(assembly, seed, judges, title=title) for seed in seeds] for assembly in assemblies]


def _trained(results: Results) -> list[TrainingJob]:
    return _on_stones([*results.size.trained.made]) if results.size.trained else []


def _on_stones(trainings: Sequence[TrainingJob]) -> list[TrainingJob]:
    """The trainings of the stepping stones' problem at scale 2."""
    own = [recipe for recipe in trainings if recipe.parameters.problem.name == RL_CBF_CLF.controller]
    return [recipe for recipe in own if recipe.plant.mass_scale == TRAINING_SCALE]
