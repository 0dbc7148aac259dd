"""Commands on a control task of your own: `rabbit evaluate`, `benchmark`, `train` with `--task TASK`."""

import json
from itertools import chain
from pathlib import Path
from shutil import rmtree
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rabbit_common.options import complaints, fail
from rabbit_common.own_folder import new_file, own_folder
from rabbit_description import ABOUT_TASK

from rabbit_experiments.conditions import Cluster, Jobs, who_runs

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from rabbit_description.task import ControlTask

    from rabbit_experiments.task_rides import RideRow, TaskRide

DECIMALS = 4  # of a barrier

Task = Annotated[str, typer.Option(help=ABOUT_TASK, metavar="TASK")]
Seed = Annotated[int, typer.Option(help="seed of starts, commands and weights", min=0, max=2**31)]
Controllers = Annotated[str, typer.Option(help="names, or policy files", metavar="NAME,...")]
Rides = Annotated[
    int, typer.Option("--rides", "--runs", help="rides of each controller, the same for all", min=1, max=100_000)
]
Out = Annotated[Path | None, typer.Option(help="folder of the results (default: runs/COMMAND-KEY, one for each)")]
Pictures = Annotated[bool, typer.Option(help="record, draw and film the first ride of each controller")]


def evaluate(
    task: Task,
    controller: Controllers = "nominal,oracle",
    rides: Rides = 10,
    seed: Seed = 1,
    out: Out = None,
    jobs: Jobs = None,
    cluster: Cluster = None,
    pictures: Pictures = False,
) -> None:
    """Ride many seeded episodes under each controller: which kept every barrier, and by how much."""
    from rabbit_experiments.task_rides import rides_of, summarise

    loaded, names = chosen(task, controller)
    asked = rides_of(task, names, rides, seed)
    folder, rows = ridden_all(asked, out, "evaluate", who_runs(jobs, cluster))
    ridden = {name: rows[i * rides : (i + 1) * rides] for i, name in enumerate(names)}
    summary = {name: summarise(loaded, of_one) for name, of_one in ridden.items()}
    show(loaded, summary)
    write_results(folder, loaded, ridden, {"seed": seed, "rides": rides, **summary})
    films = [draw_first(loaded, name, ridden[name][0].seed, folder / Path(name).stem) for name in names if pictures]
    for film in chain.from_iterable(films):  # last, since the encoder may not be installed
        print(f"written {film}")


def benchmark(
    task: Task,
    controller: Controllers = "nominal,oracle",
    rides: Rides = 10,
    seed: Seed = 1,
    out: Out = None,
    jobs: Jobs = None,
    cluster: Cluster = None,
) -> None:
    """Ride on many plants: each true parameter from nominal to twice as far off as it is, the others nominal; then
    all."""
    from rabbit_description.atomic_file import replace_text

    from rabbit_experiments.tables import markdown_table
    from rabbit_experiments.task_rides import plants_of, rides_of, summarise

    loaded, names = chosen(task, controller)
    if not (plants := plants_of(loaded)):
        fail(f"task {loaded.name}: expected true parameters that differ from the nominal ones")
    asked = [ride for plant in plants.values() for ride in rides_of(task, names, rides, seed, plant)]
    folder, rows = ridden_all(asked, out, "benchmark", who_runs(jobs, cluster))
    summaries = [summarise(loaded, rows[start : start + rides]) for start in range(0, len(rows), rides)]
    kept = iter([f"{summary['kept']} {interval(summary['kept_ci95'], 2)}" for summary in summaries])
    table = [[plant, *(next(kept) for _ in names)] for plant in plants]
    title = f"# {loaded.name}: rides that kept all, of {rides}, with Wilson's interval; seed {seed}"
    page = f"{title}\n\n{markdown_table(['plant', *(Path(name).stem for name in names)], table)}"
    print(page, end="")
    replace_text(folder / "benchmark.md", page)
    print(f"written {folder}")


def train(
    task: Task,
    out: Annotated[Path, typer.Option(help="new policy file")] = Path("policy.safetensors"),
    seed: Seed = 1,
    learner: Annotated[str, typer.Option(help="regression, ddpg, or one of your own")] = "regression",
    episodes: Annotated[int | None, typer.Option(help="rides to learn from", min=1, max=10_000)] = None,
) -> None:
    """Learn what the model gets wrong, from rides with the present estimates; scales and units are measured first."""
    from rabbit_description.task_source import load_task

    with complaints(ValueError):
        loaded = load_task(task)
    if out.suffix != ".safetensors":
        fail(f"--out {out}: expected a name that ends in .safetensors")
    new_file(out)
    from rl_trainer.task_training import train

    changes: dict[str, Any] = {"learner": learner} | ({"episodes": episodes} if episodes else {})
    with complaints(ValueError, OSError):
        policy, _ = train(loaded, seed, **changes)
        policy.file.write(out)
        print(f"written {out}")


def export(
    task: Task,
    folder: Annotated[Path, typer.Argument(help="a new or empty folder, or one of an earlier export")],
    controller: Annotated[str, typer.Option(help="nominal, or a policy file")] = "nominal",
    seed: Seed = 1,
    daqp: Annotated[Path | None, typer.Option(help="csrc of DAQP's source (default: from PyPI)")] = None,
) -> None:
    """Write a controller as C source, with a program that answers the readings of a ride.

    Example: `rabbit export c --task examples/segway.py && make -C c && (cd c && ./example)`
    """
    loaded, _ = chosen(task, controller)
    import numpy as np
    from rl_cbf_clf_controller.export import ExportError, export_ride
    from rl_cbf_clf_controller.export import export as write
    from rl_cbf_clf_controller.task_controller import TaskController
    from rl_trainer.task_episode import ride_of

    from rabbit_experiments.commands.export import daqp_source

    controllers = TaskController(loaded)
    controlling = controllers.controlling(controller)
    if controlling in controllers.brought:
        fail(f"--controller {controller}: expected one with a QP")
    own_folder(folder, "export --task")
    controllers.policy = controlling
    with complaints(ExportError), TemporaryDirectory() as temporary:
        write(controllers, folder, daqp or daqp_source(Path(temporary)))
    ride = ride_of(controllers, controlling, seed)
    readings = np.concatenate([controllers.robots.reading(moment.state) for moment in ride.moments])
    export_ride(folder, readings, np.array([moment.u for moment in ride.moments]))
    print(f"written to {folder}: controller.c, controller.h, daqp/, and an example: make -C {folder}")


def chosen(task: str, controller: str) -> "tuple[ControlTask, list[str]]":
    """The task, and the names of its controllers; ends the command where one is no controller."""
    from rabbit_description.task_source import load_task
    from rl_cbf_clf_controller.task_controller import TaskController

    names = controller.split(",")
    with complaints(ValueError):
        loaded = load_task(task)
        tried = TaskController(loaded)
        for name in names:
            tried.controlling(name)
    return loaded, names


def ridden_all(
    asked: "Sequence[TaskRide]", out: Path | None, command: str, processes: int | str
) -> "tuple[Path, list[RideRow]]":
    """The folder, and a row for each ride; one that was stopped goes on there."""
    from rabbit_experiments.provenance import key_of, plain
    from rabbit_experiments.results import results_folder, results_of

    folder = results_folder(out, f"{command} --task", key_of([plain(ride) for ride in asked]))
    return folder, results_of(asked, folder, processes)[0]


def show(task: "ControlTask", summary: dict[str, Any]) -> None:
    """The table."""
    from rich.console import Console
    from rich.table import Table

    names = [barrier.name for barrier in task.barriers]
    columns = [f"{name}: worst; mean [95%]" for name in names] + ["impacts: mean [95%]"] * (task.impact is not None)
    table = Table("controller", "rides that kept all [95%]", *columns, "outcomes")
    for controller, of in summary.items():
        row = [Path(controller).stem, f"{of['kept']} of {of['of']} {interval(of['kept_ci95'], 2)}"]
        for name in names:
            b = of["barriers"].get(name)
            row.append(f"{b['worst']:.4f}; {b['mean']:.4f} {interval(b['mean_ci95'], DECIMALS)}" if b else "-")
        if counts := of.get("impacts"):
            row.append(f"{counts['mean']:.1f} {interval(counts['mean_ci95'], 1)}")
        reasons = [f"by {name}: {count}" for name, count in of["reasons"].items() if name not in of["outcomes"]]
        table.add_row(*row, ", ".join([*(f"{count} {name}" for name, count in of["outcomes"].items()), *reasons]))
    Console().print(table)


def interval(ends: tuple[float, float] | None, digits: int) -> str:
    """An interval in words, as in (0.72, 1.00)."""
    return f"({ends[0]:.{digits}f}, {ends[1]:.{digits}f})" if ends else ""


def write_results(
    folder: Path, task: "ControlTask", ridden: "dict[str, list[RideRow]]", summary: dict[str, Any]
) -> None:
    """A row for each ride, the summary, and a picture."""
    from rabbit_description.atomic_file import replace_table, replace_text
    from rabbit_description.plugins import load

    barriers = [barrier.name for barrier in task.barriers]
    rows = [
        {"controller": name, **ride.model_dump(exclude={"margins"}), **dict(zip(barriers, ride.margins, strict=True))}
        for name, rides in ridden.items()
        for ride in rides
    ]
    with complaints(OSError):
        replace_table(folder / "runs.csv", rows)
        replace_text(folder / "summary.json", json.dumps({"task": task.name, **summary}, indent=2))
        if barriers or task.impact:
            load("rabbit.pictures", "margins")(task, ridden, folder / "margins.png")
    print(f"written {folder}")


def draw_first(task: "ControlTask", name: str, seed: int, folder: Path) -> "Iterator[Path]":
    """Ride a seed again, the same: its recording and its rows in the folder; returns what will film it there."""
    from rabbit_common.executables import LaunchError
    from rabbit_description.plugins import load
    from rabbit_recording import RecordingError
    from rabbit_recording.task_recording import write_ride
    from rl_cbf_clf_controller.policy import ActorPolicy
    from rl_cbf_clf_controller.task_controller import TaskController
    from rl_trainer.task_episode import ride_of

    controller = TaskController(task)
    controlling = controller.controlling(name)
    ride = ride_of(controller, controlling, seed)
    recording = folder / "recording"
    rmtree(recording, ignore_errors=True)  # of an earlier call
    with complaints(RecordingError, OSError):
        drawing: Iterator[Path] = load("rabbit.pictures", "ride")(ride, folder)
        print(f"written {next(drawing)}")
        try:
            write_ride(ride, recording, controlling if isinstance(controlling, ActorPolicy) else None)
            print(f"written {recording}")
        except LaunchError as error:
            print(f"no recording: {error}")
    return drawing
