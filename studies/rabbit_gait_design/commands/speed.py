"""How the speed follows from step to step: learned from walks with random changes of the slope."""

from pathlib import Path
from typing import Annotated

import typer
from rabbit_common.options import complaints, going_on_from, tell_if_bare
from rabbit_common.own_folder import own_folder
from rabbit_experiments.conditions import Cluster, Jobs, who_runs

app = typer.Typer(add_completion=False)
FIT_SEED, JUDGE_SEED = 62001, 62003  # of plants and courses; the benchmark has others


@app.command()
def speed(
    context: typer.Context,
    parameters: Annotated[
        str, typer.Option(help="file of controller parameters: best or a YAML file with its gaits")
    ] = "best",
    plants: Annotated[int, typer.Option(min=5, max=100_000, help="plants of the storm to fit on, 4 walks each")] = 40,
    others: Annotated[int, typer.Option(min=5, max=100_000, help="other plants, to judge on")] = 20,
    out: Annotated[Path, typer.Option(help="folder of the results; what was stopped goes on")] = Path("runs/speed"),
    jobs: Jobs = None,
    cluster: Cluster = None,
) -> None:
    """Learn the coefficients of `speed_regulation`; print them with their intervals and the errors on other plants."""
    from itertools import chain

    from rabbit_experiments.assembly import AssemblyError
    from rabbit_experiments.cache import Cache, JobError
    from rabbit_experiments.engine import about_so_long, run
    from rl_cbf_clf_controller.parameters import ParameterError, load_parameters
    from rl_cbf_clf_controller.speed_regulation import PER_SLOPE, RETAINED

    from rabbit_gait_design.speed_model.fit import NAMES, SpeedModelError, errors, fitted
    from rabbit_gait_design.speed_model.walks import exploring_walks, gathered

    processes = who_runs(jobs, cluster)
    tell_if_bare(
        context,
        f"Walks 4 times on each of {plants + others} plants, 40 steps a walk: "
        f"{about_so_long(8 * (plants + others), processes)}; one that is stopped goes on. To begin:",
        f"rabbit speed --plants {plants} --others {others}",
    )
    with complaints(AssemblyError, JobError, ParameterError, SpeedModelError):
        tuning = load_parameters(parameters)
        cache = Cache(own_folder(out, "speed") / "cache")
        fit, judge = exploring_walks(plants, FIT_SEED, tuning), exploring_walks(others, JUDGE_SEED, tuning)
        with going_on_from("the walks that are done"):
            run(list(chain(*fit, *judge)), cache, processes)
        model = fitted(gathered(fit, cache))
        wrong, spread = errors(model.coefficients, gathered(judge, cache))
    print(f"{model.steps} steps on {model.plants} plants, seed {FIT_SEED}")
    for name, value, half, used in zip(
        NAMES, model.coefficients, model.half_widths, (RETAINED, *PER_SLOPE), strict=True
    ):
        print(f"{name:4} {value:+.3f} +- {half:.3f}   (in use: {used:+.3f})")
    print(f"on {others} other plants, seed {JUDGE_SEED}: error {wrong:.3f} m/s of {spread:.3f} m/s")
