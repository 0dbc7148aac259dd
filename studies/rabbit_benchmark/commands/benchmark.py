"""Methods by plants under one protocol."""

import os
from pathlib import Path
from typing import Annotated, Literal

import typer
from rabbit_common.exit_codes import of_interrupt
from rabbit_common.options import complaints, fail
from rabbit_common.own_folder import own_folder

app = typer.Typer(add_completion=False)


@app.command()
def benchmark(
    methods: Annotated[
        list[str] | None,
        typer.Argument(help="methods by name, with values to try: nominal-pd:eps=0.02,0.03 (default: all)"),
    ] = None,
    cells: Annotated[
        str, typer.Option(help="cells by name, pattern or map: stones/scale-2,flat/*,inside (default: all)")
    ] = "",
    courses: Annotated[
        int, typer.Option(min=1, max=10_000, help="courses of a cell; the storm has ten times as many")
    ] = 10,
    seeds: Annotated[
        Literal["development", "reported"], typer.Option(help="seeds to tune on, or seeds of the published table")
    ] = "development",
    sensors: Annotated[
        Literal["exact", "lab"],
        typer.Option(help="exact states, or states estimated from a lab's sensors in every cell"),
    ] = "exact",
    against: Annotated[str, typer.Option(help="method that the others are compared with")] = "identified",
    out: Annotated[Path, typer.Option(help="folder of the results; what was stopped goes on")] = Path("runs/benchmark"),
    plant: Annotated[Literal["pybullet", "mujoco"], typer.Option(help="physics engine")] = "pybullet",
    batch: Annotated[
        int, typer.Option(min=1, max=4096, help="runs that a process walks at once (needs --plant mujoco)")
    ] = 1,
    jobs: Annotated[int | None, typer.Option(min=1, max=4096, help="processes (default: all cores)")] = None,
    show: Annotated[bool, typer.Option("--list", help="list methods and cells, and do nothing more")] = False,
) -> None:
    """Walk every method on every plant: DIR/benchmark.md has the map, intervals and a paired comparison."""
    from rabbit_experiments.cache import Cache, JobError
    from rabbit_experiments.engine import run

    from rabbit_benchmark.cells import CellError, chosen
    from rabbit_benchmark.methods import REFERENCE, MethodError, names, variants
    from rabbit_benchmark.protocol import Protocol, plan
    from rabbit_benchmark.report import Benchmark

    with complaints(CellError, MethodError):
        entered = [each for name in dict.fromkeys(methods or names()) for each in variants(name)]
        wanted = chosen([name for name in cells.split(",") if name])
    if batch > 1 and plant != "mujoco":
        fail(f"--batch {batch} with --plant {plant}: expected --plant mujoco")
    if show:
        for each in entered:
            print(f"{each.name:16s} {each.title}")
        for cell in wanted:
            print(f"{cell.name} ({cell.map})")
        return
    if against not in (REFERENCE, *(each.name for each in entered)):
        fail(f"--against {against}: expected one of the methods that walk")
    protocol = Protocol(courses, seeds, sensors=sensors, plant=plant)
    runs = plan(protocol, entered, wanted)
    for each in entered if methods else ():
        if all(isinstance(reason := runs[each, cell], str) for cell in wanted):
            fail(f"{each.name}: {reason}")
    cache = Cache(own_folder(out, "benchmark") / "cache")
    try:
        with complaints(JobError):
            walks = [job for each in runs.values() if not isinstance(each, str) for job in each]
            done = run(walks, cache, jobs or os.cpu_count() or 1, batch=batch)
    except KeyboardInterrupt as stop:
        fail("stopped; the same command goes on from the runs that are done", code=of_interrupt(stop))
    page = Benchmark.from_cache(protocol, entered, wanted, runs, cache, against).write(out)
    print(f"{done} runs made; written {page}")
