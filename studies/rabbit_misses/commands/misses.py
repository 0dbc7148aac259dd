"""How probable it is that a step misses its stone: fitted on some plants, judged on others."""

from pathlib import Path
from typing import Annotated

import typer
from rabbit_common.options import complaints, going_on_from, tell_if_bare
from rabbit_common.own_folder import own_folder
from rabbit_experiments.conditions import Cluster, Jobs, who_runs

app = typer.Typer(add_completion=False)


@app.command()
def misses(
    context: typer.Context,
    parameters: Annotated[
        str, typer.Option(help="file of controller parameters: ours, best, authors or a YAML file")
    ] = "best",
    model: Annotated[Path | None, typer.Option(help="file of a fitted model, which is judged; none is fitted")] = None,
    fit_plants: Annotated[int, typer.Option(min=10, max=100_000, help="plants of the storm to fit on")] = 1200,
    plants: Annotated[int, typer.Option(min=1, max=100_000, help="other plants, to judge on")] = 500,
    out: Annotated[Path, typer.Option(help="folder of the results; what was stopped goes on")] = Path("runs/misses"),
    jobs: Jobs = None,
    cluster: Cluster = None,
) -> None:
    """Fit the probability of a miss to walks in the storm, judge it in others: DIR/model.json, DIR/misses.md."""
    from rabbit_experiments.assembly import AssemblyError
    from rabbit_experiments.cache import Cache, JobError
    from rabbit_experiments.engine import about_so_long, run
    from rl_cbf_clf_controller.parameters import ParameterError

    from rabbit_misses.model import MissModelError, MissProbability
    from rabbit_misses.report import write
    from rabbit_misses.study import FIT_SEED, JUDGE_SEED, gathered, judged, stormy_walks

    processes = who_runs(jobs, cluster)
    tell_if_bare(
        context,
        f"Fits to {fit_plants:,} walks and judges on {plants:,}: {about_so_long(fit_plants + plants, processes)};"
        " one that is stopped goes on. To begin:",
        f"rabbit misses --fit-plants {fit_plants} --plants {plants}",
    )
    with complaints(AssemblyError, MissModelError, ParameterError):
        loaded = None if model is None else MissProbability.load(model)
        fit = [] if loaded else stormy_walks(fit_plants, FIT_SEED, parameters)
        judge = stormy_walks(plants, JUDGE_SEED, parameters)
    cache = Cache(own_folder(out, "misses") / "cache")
    with complaints(JobError), going_on_from("the walks that are done"):
        run([*fit, *judge], cache, processes)
    with complaints(MissModelError, OSError):
        if loaded is None:
            rows, missed = gathered(fit, cache)
            about = f"parameters {parameters}, {fit_plants} plants of the storm on stones, seed {FIT_SEED}"
            loaded = MissProbability.fitted(rows, missed, f"{about}: {len(rows)} steps, {int(missed.sum())} misses")
        rows, missed = gathered(judge, cache)
        p = loaded.at(rows)
        page = write(loaded, judged(p, missed), p, missed, plants, out)
    print(f"written {page}")
