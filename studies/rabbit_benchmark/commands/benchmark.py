"""Methods by plants under one protocol."""

from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import typer
from rabbit_common.options import complaints, fail, going_on_from, is_bare, tell_if_bare
from rabbit_common.own_folder import own_folder
from rabbit_description.state import TICK_SECONDS
from rabbit_description.tick import ABOUT_TICK
from rabbit_description.validation import one_of
from rabbit_experiments.conditions import ABOUT_BATCH, BATCH, Cluster, Jobs, who_runs
from rabbit_sim.parameters import USUAL, SimulationParameters

app = typer.Typer(add_completion=False)


@app.command()
def benchmark(
    context: typer.Context,
    methods: Annotated[
        list[str] | None,
        typer.Argument(help="methods by name, with values to try: nominal-pd:eps=0.02,0.03; or all, the default"),
    ] = None,
    cells: Annotated[
        str, typer.Option(help="cells by name, pattern or map: stones/scale-2,flat/*,inside (default: all)")
    ] = "",
    courses: Annotated[
        int, typer.Option(min=1, max=10_000, help="courses of a cell; the storm has ten times as many")
    ] = 10,
    seeds: Annotated[
        str, typer.Option(help="development: to tune on; reported: of the published table; or a number that is new")
    ] = "development",
    sensors: Annotated[
        Literal["exact", "lab"],
        typer.Option(help="exact states, or states estimated from a lab's sensors in every cell"),
    ] = "exact",
    against: Annotated[str, typer.Option(help="method that the others are compared with")] = "identified",
    out: Annotated[Path, typer.Option(help="folder of the results; what was stopped goes on")] = Path("runs/benchmark"),
    plant: Annotated[Literal["pybullet", "mujoco"], typer.Option(help="physics engine")] = USUAL,
    tick_seconds: Annotated[float, typer.Option(help=ABOUT_TICK)] = TICK_SECONDS,
    batch: Annotated[int, typer.Option(min=1, max=4096, help=ABOUT_BATCH)] = BATCH,
    jobs: Jobs = None,
    cluster: Cluster = None,
    show: Annotated[bool, typer.Option("--list", help="list methods and cells, and do nothing more")] = False,
) -> None:
    """Walk methods on plants: DIR/benchmark.md has the map, intervals and a paired comparison. Without any option: what
    there is, and how long it takes."""
    from rabbit_experiments.cache import Cache, JobError
    from rabbit_experiments.engine import about_so_long, progress_bar, run

    from rabbit_benchmark.cells import CellError, chosen
    from rabbit_benchmark.methods import REFERENCE, MethodError, names, variants
    from rabbit_benchmark.protocol import SEEDS, Protocol, plan
    from rabbit_benchmark.report import Benchmark

    with complaints(CellError, MethodError):
        methods = None if methods == ["all"] else methods
        entered = list(dict.fromkeys(method for name in methods or names() for method in variants(name)))
        wanted = chosen([name for name in cells.split(",") if name])
    with complaints():
        tick_seconds = SimulationParameters(tick_seconds=tick_seconds).tick_seconds
    processes = who_runs(jobs, cluster)
    if show or is_bare(context):
        for method in entered:
            print(f"{method.name:16s} {method.title}")
        for cell in wanted:
            print(f"{cell.name} ({cell.map})")
        of = [cell.courses(courses) for method in entered for cell in wanted if method.on(cell.terrain, cell.map)]
        size = f"{len(entered)} methods on {len(wanted)} cells: {sum(of):,} courses"
        tell_if_bare(
            context,
            f"{size}, {about_so_long(sum(of), processes)}; one that is stopped goes on. To begin:",
            "rabbit benchmark all",
            "rabbit benchmark best nominal-tuned --cells inside",
        )
        return
    if against not in (REFERENCE, *(method.name for method in entered)):
        fail(f"--against {against}: expected {one_of(against, [REFERENCE, *(method.name for method in entered)])}")
    if seeds not in SEEDS and not (seeds.isascii() and seeds.isdecimal() and len(seeds) < 10):
        fail(f"--seeds {seeds}: expected {', '.join(SEEDS)} or a number of up to 9 digits")
    protocol = Protocol(courses, seeds, sensors=sensors, plant=plant, tick_seconds=tick_seconds)
    with progress_bar() as bar:
        runs = plan(protocol, entered, wanted, partial(bar.track, description="plans"))
    for method in entered if methods else ():
        if all(isinstance(reason := runs[method, cell], str) for cell in wanted):
            fail(f"{method.name}: {reason}")
    cache = Cache(own_folder(out, "benchmark") / "cache")
    with complaints(JobError), going_on_from("the runs that are done"):
        walks = [job for jobs in runs.values() if not isinstance(jobs, str) for job in jobs]
        done = run(walks, cache, processes, batch=batch)
    page = Benchmark(protocol, entered, wanted, runs, cache, against).write(out)
    print(f"{done} runs made; written {page}")
