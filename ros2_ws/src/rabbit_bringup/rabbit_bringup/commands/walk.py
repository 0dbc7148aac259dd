"""`rabbit walk`: the three nodes walk together, under one progress line, and leave a folder."""

from datetime import datetime
from pathlib import Path
from typing import Any

import typer
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters

from rabbit_bringup.commands.evaluate import given_assembly
from rabbit_bringup.commands.options import Given, complaints, fail, options
from rabbit_bringup.launching.walk import Graph, Interrupted, WalkOptions, make_graph, run_graph

FELL = 1
# where the command line names neither controller nor parameters
DEFAULTS: dict[str, Any] = {"controller": "rl-cbf-clf-qp", "mass_scale": "2"}

app = typer.Typer(add_completion=False)


@app.command()
@options(WalkOptions, ControllerParameters, SimulationParameters)
def walk(given: Given) -> None:
    """Walk through the node graph: simulator, controller, trainer, recorder. Exit code 1 if the robot falls."""
    if not given.values.keys() & {"controller", "parameters"}:
        given = Given({**DEFAULTS, **given.values})
    request = given.build(WalkOptions)
    assembly = given_assembly(given, request.policy, request.parameters)
    if assembly.policy == "oracle":
        fail("--policy oracle: expected zero, a shipped policy or a file; the nodes never see the true plant")
    folder = make_folder(request)
    simulation, controller = assembly.simulation, assembly.controller
    training = given_training(request, controller, assembly.policy) if request.trainer else None
    graph = make_graph(folder, request, simulation, controller, assembly.policy, training)
    if request.view:
        print(
            f"live view at ws://127.0.0.1:{request.view_port}" if request.view_port else "live view: see log/viewer.log"
        )
    ended, seconds = walk_with_progress(graph, request)
    show(folder, ended)
    if request.record != "none":
        tell(folder, request, simulation, controller, seconds)
    print(f"written to {folder}")
    if any(episode.outcome != "walked" for episode in ended):
        raise typer.Exit(FELL)


def given_training(request: WalkOptions, controller: ControllerParameters, policy: str) -> dict[str, Any]:
    """The trainer's parameters: the file's, or those that fit the policy, for this controller's problem."""
    from rl_trainer.parameters import ParameterError, TrainingParameters, load_parameters

    known: dict[str, Any] = {"problem": controller.problem, "seed": request.seed}
    if policy != "zero" and not request.training:
        known |= form_of(Path(policy))
    with complaints(ParameterError):
        training = load_parameters(request.training, **known) if request.training else TrainingParameters(**known)
    return training.model_dump(mode="json")


def form_of(policy: Path) -> dict[str, Any]:
    """Parameters of a training that goes on from a policy file."""
    from rl_cbf_clf_controller.weights import read

    form = read(policy).metadata
    return {
        "structured": form.structured,
        "observe_l_min": form.observation == form.problem.observation,
        "hidden1": form.hidden[0],
        "hidden2": form.hidden[1],
        "alpha_scale": form.alpha_scale,
        "beta_scale": form.beta_scale,
    }


def make_folder(request: WalkOptions) -> Path:
    """The walk's own folder, new."""
    name = f"{datetime.now():%Y%m%d-%H%M%S}-seed-{request.seed}"
    return new_folder(request.out or Path("runs") / name)


def new_folder(path: Path) -> Path:
    """Make a folder, or take an empty one; ends the command if it is neither."""
    folder = path.absolute()
    if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
        fail(f"--out {folder}: expected a new or empty folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        fail(f"--out {folder}: {error.strerror}")
    return folder


def walk_with_progress(graph: Graph, request: WalkOptions) -> tuple[list[Any], float]:
    """How each episode ended, and the wall seconds of all."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from rabbit_bringup.launching.executables import LaunchError

    text = TextColumn("{task.description} {task.fields[text]}")
    columns = (BarColumn(bar_width=12), text, TimeElapsedColumn())
    with Progress(*columns) as bar:
        task = bar.add_task("starting", total=None, text=" ".join(graph.names))

        def glance(now: Any) -> None:
            episode = f"episode {now.episode}, " if request.episodes > 1 else ""
            text = f"margin {now.margin * 1e3:.0f} mm, slack {now.slack:.2f}, force ratio {now.ratio:.2f}"
            description = f"{episode}stone {now.stone} of {now.stones},"
            bar.update(task, description=description, total=now.stones, completed=now.stone, text=text)

        try:
            return run_graph(graph, request, glance)
        except LaunchError as error:
            bar.stop()
            fail(error, code=FELL)
        except Interrupted as error:
            bar.stop()
            fail(f"stopped by {error}; what was recorded is in {graph.folder}", code=error.code)


def show(folder: Path, ended: list[Any]) -> None:
    """A line an episode."""
    for e in ended:
        reason = f" ({e.reason})" if e.reason else ""
        walked = f"{e.touchdowns - (e.outcome == 'miss')} of {e.stones} stones, {e.tick} ticks"
        print(f"episode {e.episode}, seed {e.seed}: {e.outcome}{reason}, {walked}")


def tell(
    folder: Path,
    request: WalkOptions,
    simulation: SimulationParameters,
    controller: ControllerParameters,
    seconds: float,
) -> None:
    """Summary, pictures and film from the recording."""
    from rabbit_bringup.launching.telling import write_summary
    from rabbit_bringup.recording.bag_writer import RecordingError

    with complaints(RecordingError):
        summary = write_summary(folder, simulation, controller, seconds)
    print(f"{summary['ticks']} ticks in {seconds:.1f} s: {summary['real_time_factor'] or 0:.1f} times real time")
    if timing := summary["real_time"]:
        print(
            f"real time: {timing['late_share']:.2%} of the ticks more than 2 ms late, {timing['missed']} unanswered in "
            f"time; age of the torque {timing['age_ms']['p99']:.1f} ms (p99)"
        )
    if not summary["ticks"]:
        return
    from rich.console import Console

    with Console().status("drawing"):
        if request.pictures:
            from rabbit_bringup.viewing.pictures import draw_run

            draw_run(folder)
        if request.video:
            from rabbit_bringup.viewing.video import film_run

            film_run(folder)
