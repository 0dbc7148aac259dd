"""Make the paper's figures and tables anew, with its figures beside ours."""

from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import typer
from rabbit_common.options import complaints, fail, going_on_from, is_bare, tell_if_bare
from rabbit_common.own_folder import own_folder
from rabbit_description.validation import one_of
from rabbit_experiments.conditions import Cluster, Jobs, who_runs

PlantName = Literal["pybullet", "mujoco", "rigid"]

app = typer.Typer(add_completion=False)


@app.command()
def reproduce(
    context: typer.Context,
    names: Annotated[
        list[str] | None, typer.Argument(help="experiments by name; or all, the default: all that need no --retrain")
    ] = None,
    quick: Annotated[bool, typer.Option("--quick", help="make few runs of everything")] = False,
    retrain: Annotated[bool, typer.Option("--retrain", help="train the policies first, into DIR/training")] = False,
    out: Annotated[Path, typer.Option(help="folder of the results; what was stopped goes on")] = Path("runs/reproduce"),
    jobs: Jobs = None,
    cluster: Cluster = None,
    plant: Annotated[PlantName, typer.Option(help="plant on which the claims are judged")] = "pybullet",
    figure: Annotated[
        int | None, typer.Option(min=1, max=5, help="number of the paper's figure to make; Fig. 1 is a drawing")
    ] = None,
    show: Annotated[bool, typer.Option("--list", help="list the experiments, and do nothing more")] = False,
) -> None:
    """Make the paper's figures and tables anew: DIR/results.md has its figures beside ours, with verdicts. Without any
    option: what there is, and how long it takes."""
    from rabbit_experiments.cache import JobError
    from rabbit_experiments.engine import about_so_long

    from rabbit_reproduce.catalogue import EXPERIMENTS
    from rabbit_reproduce.experiment import FIGURES
    from rabbit_reproduce.page import make
    from rabbit_reproduce.table_lines import FULL, QUICK
    from rabbit_reproduce.training import retrain as retrained

    known = {experiment.name: experiment for experiment in EXPERIMENTS}
    names, processes = None if names == ["all"] else names, who_runs(jobs, cluster)
    if figure:
        shown = [name for name, experiment in known.items() if experiment.label == FIGURES[figure - 1]]
        names = [
            *(names or ()),
            *(shown or fail(f"--figure {figure}: expected 2 to 5, Fig. 1 is a drawing of the method")),
        ]
    if show or is_bare(context):
        for name, experiment in known.items():
            needs = "; needs --retrain" * experiment.needs_training
            print(f"{name:24s} {experiment.title} ({experiment.place}){needs}")
        if is_bare(context):
            runs = sum(len(experiment.jobs(FULL)) for experiment in known.values() if not experiment.needs_training)
            tell_if_bare(
                context,
                f"All that need no --retrain: up to {runs:,} runs, {about_so_long(runs, processes)}; --quick makes few."
                " One that is stopped goes on. To begin:",
                "rabbit reproduce all",
                "rabbit reproduce clf-results --quick",
            )
        return
    if wrong := [name for name in names or () if name not in known]:
        fail(f"{wrong[0]}: expected {one_of(wrong[0], known)}")
    if wrong := [name for name in names or () if known[name].needs_training and not retrain]:
        fail(f"{wrong[0]}: expected --retrain, it needs the policies of all episodes of a training")
    own_folder(out, "reproduce")
    chosen = [e for name, e in known.items() if name in (names or known) and (retrain or not e.needs_training)]
    size = replace(QUICK if quick else FULL, plant=plant)
    with complaints(JobError), going_on_from("the runs that are done"):
        if retrain:
            wanted = dict.fromkeys(recipe for experiment in chosen for recipe in experiment.trainings(size))
            trained = retrained(list(wanted), out / "training", processes, plant)
            size = replace(size, trained=trained)
        page, done = make(chosen, size, out, list(known), processes)
    print(f"{done} runs made; written {page}")
