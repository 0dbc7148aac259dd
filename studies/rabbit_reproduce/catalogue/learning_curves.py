"""How many episodes the learning takes [sec: Reinforcement Learning Settings], and its curves."""

from collections.abc import Sequence
from itertools import groupby
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from rabbit_experiments.conditions import TRAINING_SCALE
from rabbit_experiments.evaluation import SeededRun
from rabbit_viewer import style
from rl_cbf_clf_controller.kinds import find_problem
from rl_trainer.parameters import TrainingParameters

from rabbit_reproduce.controllers import IO_RL, RL_CBF_CLF, RL_CLF, Contender
from rabbit_reproduce.experiment import Experiment
from rabbit_reproduce.report import Cell, Claim, Table
from rabbit_reproduce.table_lines import MAIN, Line, Results, Size
from rabbit_reproduce.training import Episode, TrainingJob, read_log, recipe_of, recipes

PAPER = {IO_RL: 110, RL_CLF: 79, RL_CBF_CLF: 133}  # episodes of the final agent
COLOURS = {IO_RL: style.ORANGE, RL_CLF: style.BLUE, RL_CBF_CLF: style.GREEN}
MARKERS = {IO_RL: "s", RL_CLF: "o", RL_CBF_CLF: "^"}
STEPS = TrainingParameters().walking_steps  # of an episode
Session = tuple[Episode, ...]


class LearningCurves(Experiment):
    """The curves of the trainings of `--retrain`, or else of the log in the package."""

    name = "learning-curves"

    def trainings(self, size: Size) -> list[TrainingJob]:
        """All."""
        return recipes(size.quick)

    def jobs(self, size: Size) -> list[SeededRun]:
        return [job for line in trained_lines(size).values() for job in line.scenario(size).walks]

    def tables(self, results: Results) -> Sequence[Table]:
        walks = {recipe: results.walks(line).text for recipe, line in trained_lines(results.size).items()}
        columns = (
            *("problem", "scale", "seed", "episodes", "transitions", "first ten steps", "ten steps in all from"),
            *("last policy, at its scale", "commit"),
        )
        rows = [_row(session, walks) for session in sessions(results.size)]
        episodes = tuple(tuple(row.model_dump().values()) for session in sessions(results.size) for row in session)
        every = Table("episodes", tuple(Episode.model_fields), episodes)
        return Table("trainings", columns, tuple(rows)), every

    def figures(self, results: Results) -> dict[str, Figure]:
        return {"learning_curves": learning_figure(by_contender(results.size))}

    def claims(self, results: Results) -> list[Claim]:
        """The claims of each problem."""
        return [self._claim(contender, own) for contender, own in by_contender(results.size).items()]

    def _claim(self, contender: Contender, own: Sequence[Session]) -> Claim:
        last, ends = [settled(session) for session in own], [len(session) for session in own]
        firsts = [first_whole(session) for session in own]
        parts = {
            "in no more episodes than the paper's": max(ends) <= PAPER[contender],
            "from some episode on all walk ten steps, in each seed": None not in last,
        }
        ours = (
            f"{span(ends)} episodes, {span([session[-1].transitions for session in own])} transitions; first ten "
            f"steps in episode {span(firsts)}, ten in all episodes from {span(last)} (seeds: {len(own)})"
        )
        return self.claim("episodes", ours, parts, who=contender.title, most=str(PAPER[contender]))


def sessions(size: Size) -> list[Session]:
    """Every training, in the order of the log."""
    rows = size.trained.episodes() if size.trained else read_log()
    return [tuple(group) for _, group in groupby(rows, key=lambda row: (row.problem, row.mass_scale, row.seed))]


def by_contender(size: Size) -> dict[Contender, list[Session]]:
    """The trainings at scale 2."""
    every = [session for session in sessions(size) if session[0].mass_scale == TRAINING_SCALE]
    own = {who: [session for session in every if session[0].problem == who.controller] for who in PAPER}
    return {who: sessions for who, sessions in own.items() if sessions}


def trained_lines(size: Size) -> dict[TrainingJob, Line]:
    """A line for the last policy of each training of `--retrain`, at the scale that it was trained at."""
    if not (trained := size.trained):
        return {}
    contenders, lines = {contender.controller: contender for contender in PAPER}, dict[TrainingJob, Line]()
    for recipe in trained.made:
        who = contenders[recipe.parameters.problem.name].with_policy(str(trained.policy(recipe)))
        lines[recipe] = Line(recipe.name, who.assembly(mass_scale=recipe.plant.mass_scale), columns=(MAIN,))
    return lines


def first_whole(session: Session) -> int | None:
    """The first episode with all ten steps."""
    return next((row.episode for row in session if row.steps >= STEPS), None)


def settled(session: Session) -> int | None:
    """The first episode from which on all have ten steps."""
    short = [row.episode for row in session if row.steps < STEPS]
    first = short[-1] + 1 if short else 1
    return first if first <= len(session) else None


def span(values: Sequence[int | None]) -> str:
    """Least to most; `none` where one is missing."""
    known = [value for value in values if value is not None]
    if not known:
        return "none"
    text = f"{min(known):,}" + f" to {max(known):,}" * (min(known) != max(known))
    return text + f" (in {len(values) - len(known)} none)" * (len(known) < len(values))


def _row(session: Session, walks: dict[TrainingJob, str]) -> tuple[Cell, ...]:
    end = session[-1]
    recipe = recipe_of(find_problem(end.problem), end.seed, end.mass_scale)
    marks = (first_whole(session), settled(session))
    head = (end.problem, f"{end.mass_scale:g}", end.seed, end.episode, end.transitions)
    return (*head, *marks, walks.get(recipe), end.commit[:12] + "+" * end.commit.endswith("+"))


def learning_figure(trainings: dict[Contender, list[Session]]) -> Figure:
    """Steps and errors over episodes."""
    figure, (steps, errors) = style.figure(2, height=2.3)
    for contender, own in trainings.items():
        _curve(steps, contender, [[row.steps for row in session] for session in own])
        _curve(errors, contender, [[-row.reward or np.nan for row in session] for session in own])
    steps.set(ylabel="steps walked", ylim=(-0.3, STEPS + 0.5))
    steps.yaxis.set_major_locator(MaxNLocator(integer=True))
    errors.set(ylabel="mean squared error", yscale="log", xlabel="episode")
    errors.xaxis.set_major_locator(MaxNLocator(integer=True))
    style.legend(steps, columns=3)
    figure.align_ylabels()
    return figure


def _curve(axes: Axes, contender: Contender, values: Sequence[Sequence[float]]) -> None:
    """Median and range over the sessions, as far as all of them go."""
    length = min(map(len, values))
    table = np.array([row[:length] for row in values])
    episodes = np.arange(1, length + 1)
    look: dict[str, Any] = {"color": COLOURS[contender], "marker": MARKERS[contender], "markersize": 3.5}
    label = f"{contender.title} ({len(values)} seed{'s' * (len(values) > 1)})"
    low, middle, high = np.nanpercentile(table, (0, 50, 100), axis=0)
    axes.plot(episodes, middle, label=label, **look)
    axes.fill_between(episodes, low, high, color=COLOURS[contender], alpha=0.18, linewidth=0)
