"""A control task of your own: ride, check; also `rabbit evaluate`, `benchmark`, `train`, `play --task TASK`."""

import csv
import json
import os
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from rabbit_common.exit_codes import of_interrupt
from rabbit_common.options import complaints, fail
from rabbit_common.own_folder import new_file, own_folder

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rabbit_description.task import ControlTask
    from rabbit_experiments.task_rides import RideRow, TaskRide
    from rl_trainer.task_episode import Ride

DIFFERS = 1
DECIMALS = 4  # of a barrier

app = typer.Typer(help=__doc__, no_args_is_help=True, add_completion=False)
Task = Annotated[
    str, typer.Argument(help="a .py file with a ControlTask, a walker's .yaml, or an entry point in rabbit.systems")
]
Seed = Annotated[int, typer.Option(help="seed of starts, commands and weights", min=0, max=2**31)]
Controllers = Annotated[str, typer.Option(help="names, or policy files", metavar="NAME,...")]
Rides = Annotated[
    int, typer.Option("--rides", "--runs", help="rides of each controller, the same for all", min=1, max=100_000)
]
Out = Annotated[Path | None, typer.Option(help="folder of the results (default: runs/COMMAND-KEY, one for each)")]
Jobs = Annotated[int | None, typer.Option(min=1, max=4096, help="processes (default: all cores)")]


@app.command()
def evaluate(
    task: Task,
    controller: Controllers = "nominal,oracle",
    rides: Rides = 10,
    seed: Seed = 1,
    out: Out = None,
    jobs: Jobs = None,
) -> None:
    """Ride many seeded episodes under each controller: which kept every barrier, and by how much."""
    from rabbit_experiments.task_rides import rides_of, summarise

    loaded, names = chosen(task, controller)
    asked = rides_of(task, names, rides, seed)
    folder, rows = walked(asked, out, "evaluate", jobs)
    ridden = {name: rows[i * rides : (i + 1) * rides] for i, name in enumerate(names)}
    summary = {name: summarise(loaded, of_one) for name, of_one in ridden.items()}
    show(loaded, summary)
    write_results(folder, loaded, ridden, {"seed": seed, "rides": rides, **summary})


@app.command()
def benchmark(
    task: Task,
    controller: Controllers = "nominal,oracle",
    rides: Rides = 10,
    seed: Seed = 1,
    out: Out = None,
    jobs: Jobs = None,
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
    folder, rows = walked(asked, out, "benchmark", jobs)
    summaries = [summarise(loaded, rows[start : start + rides]) for start in range(0, len(rows), rides)]
    kept = iter([f"{summary['kept']} {interval(summary['kept_ci95'], 2)}" for summary in summaries])
    table = [[plant, *(next(kept) for _ in names)] for plant in plants]
    title = f"# {loaded.name}: rides that kept all, of {rides}, with Wilson's interval; seed {seed}"
    page = f"{title}\n\n{markdown_table(['plant', *(Path(name).stem for name in names)], table)}"
    print(page, end="")
    replace_text(folder / "benchmark.md", page)
    print(f"written {folder}")


def chosen(task: str, controller: str) -> "tuple[ControlTask, list[str]]":
    """The task, and the names of its controllers; ends the command where one is no controller."""
    from rl_cbf_clf_controller.task_controller import TaskController

    loaded, names = load(task), controller.split(",")
    made = TaskController(loaded)
    with complaints(ValueError):
        for name in names:
            made.controlling(name)
    return loaded, names


def walked(
    asked: "Sequence[TaskRide]", out: Path | None, command: str, jobs: int | None
) -> "tuple[Path, list[RideRow]]":
    """The folder, and a row for each ride; one that was stopped goes on there."""
    from rabbit_experiments.cache import Cache, JobError
    from rabbit_experiments.engine import run
    from rabbit_experiments.provenance import key_of, plain

    name = out or Path("runs", f"{command}-{key_of([plain(ride) for ride in asked])[:8]}")
    folder = own_folder(name, f"system {command}")
    cache = Cache(folder / "cache")
    try:
        with complaints(JobError):
            run(asked, cache, jobs or os.cpu_count() or 1)
    except KeyboardInterrupt as stop:
        fail("stopped; the same command goes on from the rides that are done", code=of_interrupt(stop))
    return folder, [cache.get(ride) for ride in asked]


def load(source: str) -> "ControlTask":
    """The task; ends the command where there is none, or it is wrong."""
    from rabbit_description.task import TaskError
    from rabbit_description.task_source import load_task

    with complaints(TaskError):
        return load_task(source)


def show(task: "ControlTask", summary: dict[str, Any]) -> None:
    """The table."""
    from rich.console import Console
    from rich.table import Table

    names = [each.name for each in task.barriers]
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
    """As in (0.72, 1.00)."""
    return f"({ends[0]:.{digits}f}, {ends[1]:.{digits}f})" if ends else ""


def write_results(
    folder: Path, task: "ControlTask", ridden: "dict[str, list[RideRow]]", summary: dict[str, Any]
) -> None:
    """A row for each ride, the summary, and a picture."""
    from rabbit_description.atomic_file import replace_text, replacing

    from own_systems.pictures import draw_margins

    with complaints(OSError):
        with replacing(folder / "runs.csv") as partial, partial.open("w", newline="", encoding="utf-8") as file:
            table = csv.writer(file)
            names = (barrier.name for barrier in task.barriers)
            table.writerow(["controller", "seed", "ticks", "outcome", "reason", "kept", "impacts", *names])
            for name, rides in ridden.items():
                for ride in rides:
                    ended = ride.ticks, ride.outcome, ride.reason, ride.is_kept, ride.impacts
                    table.writerow([name, ride.seed, *ended, *ride.margins])
        replace_text(folder / "summary.json", json.dumps({"task": task.name, **summary}, indent=2))
        draw_margins(task, ridden, folder / "margins.png")
    print(f"written {folder}")


@app.command()
def train(
    task: Task,
    out: Annotated[Path, typer.Option(help="new policy file")] = Path("policy.safetensors"),
    seed: Seed = 1,
    learner: Annotated[str, typer.Option(help="regression, ddpg, or one of your own")] = "regression",
    episodes: Annotated[int | None, typer.Option(help="rides to learn from", min=1, max=10_000)] = None,
) -> None:
    """Learn what the model gets wrong, from rides with the present estimates; scales and units are measured first."""
    loaded = load(task)
    if out.suffix != ".safetensors":
        fail(f"--out {out}: expected a name that ends in .safetensors")
    new_file(out)
    from rl_trainer.task_training import train

    changes: dict[str, Any] = {"learner": learner} | ({"episodes": episodes} if episodes else {})
    with complaints(ValueError, OSError):
        policy, _ = train(loaded, seed, **changes)
        policy.file.write(out)
        print(f"written {out}")


@app.command()
def ride(
    task: Task,
    out: Annotated[Path, typer.Option(help="folder for recording, plot and film")] = Path("runs/ride"),
    controller: Annotated[str, typer.Option(help="its name, or a policy file")] = "nominal",
    seed: Seed = 1,
) -> None:
    """Ride one episode: recording/, rows.png and, of a task that has `draw`, ride.mp4."""
    loaded = load(task)
    from rabbit_common.executables import LaunchError
    from rabbit_recording import RecordingError
    from rl_cbf_clf_controller.policy import ActorPolicy
    from rl_cbf_clf_controller.task_controller import TaskController
    from rl_trainer.task_episode import ride_of

    from own_systems.recording import write_ride

    made = TaskController(loaded)
    with complaints(ValueError):
        controlling = made.controlling(controller)
    folder = own_folder(out, "system ride")
    ridden = ride_of(made, controlling, seed)
    with complaints(LaunchError, RecordingError, OSError):
        write_ride(ridden, folder / "recording", controlling if isinstance(controlling, ActorPolicy) else None)
        said = f"{ridden.outcome}: {ridden.reason}" if ridden.reason else ridden.outcome
        print(f"{said}, kept: {'yes' if ridden.is_kept else 'no'}, {len(ridden.moments)} ticks")
        print(folder / "recording")
    draw_all(ridden, folder)


@app.command()
def play(
    task: Task,
    controller: Controllers = "nominal,oracle",
    seed: Seed = 1,
    port: Annotated[int, typer.Option(help="port of the page; 0: any free one", min=0, max=65535)] = 8765,
    browser: Annotated[bool, typer.Option(help="open the page in a browser")] = True,
) -> None:
    """Watch two controllers ride side by side in the browser, and change the true system as they do."""
    loaded, names = chosen(task, controller)
    from rabbit_viewer.page import PageError
    from rabbit_viewer.play import playing
    from rabbit_viewer.play.serving import serve
    from rabbit_viewer.play.settings import PlayError

    from own_systems.play import Start, TaskPlayer, check_asked, settings_of

    with complaints(PageError, PlayError):
        start = Start(task, tuple(names), seed)
        passes = partial(check_asked, settings_of(loaded, start))
        serve(passes, partial(playing.play, TaskPlayer), start, port, browser)


@app.command()
def check(
    recording: Annotated[Path, typer.Argument(help="a recording's folder, or its .mcap file")],
    task: Task,
) -> None:
    """Replay recorded states through the controller, as `rabbit bag check --task TASK`; exit code 1 if an input differs
    or a tick is lost."""
    loaded = load(task)
    from rabbit_recording import RecordingError
    from rabbit_recording.reader import iterate_inventories, messages

    from own_systems.recording import differing

    with complaints(RecordingError):
        count, wrong, furthest = differing(loaded, recording)
        answered = {(m.episode, m.tick) for _, m in messages(recording, "torque")}
        lost = max(sum(episode.lost for episode in iterate_inventories(recording)), len(answered) - count)
    said = f"{len(wrong)} differ, by up to {furthest:.3g}, in ticks {wrong[:5]}" if wrong else "inputs identical"
    print(f"{count} ticks replayed, {lost} lost, {said}")
    if wrong or lost:
        raise typer.Exit(DIFFERS)


def plot_recording(recording: Path, task: str, out: Path | None, episode: int | None, form: str) -> None:
    """`rabbit bag plot --task`: rows.FORM and, of a task that has `draw`, ride.mp4."""
    loaded, folder = load(task), out or recording.with_name(f"{recording.stem}-pictures")
    ridden = recorded(loaded, recording, episode)
    draw_all(ridden, own_folder(folder, "bag plot"), form)


def show_recording(
    recording: Path, task: str, port: int, browser: bool, export: Path | None, episode: int | None
) -> None:
    """`rabbit bag show --task`: rows and pictures on the page."""
    from rabbit_viewer.page import PageError

    from own_systems.page import show

    ridden = recorded(load(task), recording, episode)
    with complaints(PageError):
        show(ridden, port, browser, export)


def explain_recording(recording: Path, task: str, tick: int | None, picture: Path | None, episode: int | None) -> None:
    """`rabbit bag explain --task`: a tick, or the one with the most slack of last resort, where none is named."""
    from own_systems.page import explained, title_of_tick, worst_tick

    ridden = recorded(load(task), recording, episode)
    with complaints(ValueError, OSError):
        tick = worst_tick(ridden) if tick is None else tick
        explanation, lines = explained(ridden, tick)
        print(*lines, sep="\n")
        if picture:
            from rabbit_viewer.explanation_picture import draw_explanation

            print(draw_explanation(explanation, picture, title_of_tick(ridden, tick)))


def recorded(task: "ControlTask", recording: Path, episode: int | None) -> "Ride":
    """An episode; ends the command where there is none."""
    from rabbit_recording import RecordingError

    from own_systems.recording import recorded_ride

    with complaints(RecordingError):
        return recorded_ride(task, recording, episode)


def draw_all(ridden: "Ride", folder: Path, form: str = "png") -> None:
    """Its rows and its film, if it has `draw`, into the folder."""
    from rabbit_viewer.video import VideoError

    from own_systems.pictures import draw_ride, film

    with complaints(VideoError, OSError):
        print(draw_ride(ridden, folder / f"rows.{form}"))
        if ridden.task.draw:
            print(*film(ridden, folder / "ride.mp4"), sep="\n")
