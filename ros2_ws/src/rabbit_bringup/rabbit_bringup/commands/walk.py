"""Walk through the node graph: simulator, controller, trainer, recorder."""

from collections.abc import Mapping
from datetime import datetime
from itertools import count
from pathlib import Path
from types import MappingProxyType
from typing import Any

import typer
from rabbit_cli import exit_codes
from rabbit_cli.options import Defaults, Given, complaints, fail, options
from rabbit_experiments.commands.evaluate import given_assembly
from rabbit_experiments.conditions import EVALUATION_LAG, TRAINING_SCALE
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters

from rabbit_bringup.launching.walk import Graph, Walk, WalkOptions, make_graph, run_graph
from rabbit_bringup.launching.walk_report import Ended, carry_out

MODELS = (WalkOptions, ControllerParameters, SimulationParameters)
SAME = {model: {name: name for name in model.model_fields} for model in (SimulationParameters, ControllerParameters)}
# of a node's parameters, those that an option decides
OPTIONS: dict[str, dict[str, str]] = {
    "simulator": {
        **{name: name for name in ("seed", "episodes", "real_time", "priority", "pace")},
        **SAME[SimulationParameters],
    },
    "controller": {"policy": "policy", "swap_at": "swap_at", **SAME[ControllerParameters]},
    "trainer": {},
    "recorder": {"storage": "record"},
    "viewer": {"port": "view_port"},
}
DEFAULTS = Defaults(
    always={"motor_lag": EVALUATION_LAG}, bare={"controller": "rl-cbf-clf-qp", "mass_scale": TRAINING_SCALE}
)

app = typer.Typer(add_completion=False)


@app.command(epilog=exit_codes.EPILOG)
@options(*MODELS, defaults=DEFAULTS)
def walk(given: Given) -> None:
    """Walk through the node graph: simulator, controller, trainer, recorder."""
    walk, graph = prepare(given)
    raise typer.Exit(carry_out(walk, lambda ended: walk_with_progress(graph, walk.options, ended)))


def prepare(given: Given) -> tuple[Walk, Graph]:
    """The walk that is asked for, and the graph that walks it; makes its folder. Ends the command if it cannot be."""
    given, further = with_file(given)
    request = given.build(WalkOptions)
    assembly = given_assembly(given, request.policy, request.parameters)
    if assembly.policy == "oracle":
        fail("--policy oracle: expected zero, a shipped policy or a file; the nodes never see the true plant")
    controller, trainer = assembly.controller, further.get("trainer", {})
    training = given_training(request, controller, assembly.policy, trainer) if request.trainer else None
    walk = Walk(folder=make_folder(request), options=request, simulation=assembly.simulation, controller=controller)
    graph = make_graph(walk.folder, request, walk.simulation, controller, assembly.policy, training, further)
    if request.view:
        print(
            f"live view at ws://127.0.0.1:{request.view_port}" if request.view_port else "live view: see log/viewer.log"
        )
    return walk, graph


def with_file(given: Given) -> tuple[Given, Mapping[str, dict[str, Any]]]:
    """What is given, and beneath it what a ROS parameter file says; its parameters that are no option, by node."""
    from rabbit_bringup.launching.parameter_file import ParameterFileError, read_parameters

    request = given.build(WalkOptions)
    if request.params_file is None:
        return given, {}
    with complaints(ParameterFileError):
        told = read_parameters(request.params_file, request.namespace, tuple(OPTIONS))
    found: dict[str, Any] = {}
    for node, options_of in OPTIONS.items():
        found |= {options_of[name]: told[node].pop(name) for name in list(told[node]) if name in options_of}
    return given.over(found), told


def given_training(
    request: WalkOptions, controller: ControllerParameters, policy: str, told: Mapping[str, Any] = MappingProxyType({})
) -> dict[str, Any]:
    """The trainer's parameters: the file's, or those `told` and those that fit the policy, for this problem."""
    from rl_trainer.parameters import ParameterError, TrainingParameters, load_parameters

    known: dict[str, Any] = {"problem": controller.problem, "seed": request.seed}
    if not request.training:
        known = {name: value for name, value in told.items() if name in TrainingParameters.model_fields} | known
        known |= form_of(Path(policy)) if policy != "zero" else {}
    with complaints(ParameterError):
        training = load_parameters(request.training, **known) if request.training else TrainingParameters(**known)
    return training.model_dump(mode="json")


def form_of(policy: Path) -> dict[str, Any]:
    """Parameters of a training that goes on from a policy file."""
    from rl_cbf_clf_controller.kinds import find_problem
    from rl_cbf_clf_controller.uncertainty import STEP_LENGTH
    from rl_cbf_clf_controller.weights import read

    form = read(policy).metadata
    return {
        "structured": form.structured,
        "observe_l_min": set(find_problem(form.problem).omissible) <= set(form.observation),
        "observe_step_length": STEP_LENGTH in form.observation,
        "hidden1": form.hidden[0],
        "hidden2": form.hidden[1],
        "alpha_scale": form.alpha_scale,
        "beta_scale": form.beta_scale,
    }


def make_folder(request: WalkOptions) -> Path:
    """The walk's own folder, new."""
    if request.out:
        return new_folder(request.out)
    name = f"{datetime.now():%Y%m%d-%H%M%S}-seed-{request.seed}"
    names = (name if number == 1 else f"{name}-{number}" for number in count(1))
    return new_folder(next(path for path in (Path("runs") / name for name in names) if not path.exists()))


def new_folder(path: Path) -> Path:
    """Make a folder, or take an empty one; ends the command if it is neither."""
    folder = path.absolute()
    try:
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            fail(f"--out {folder}: expected a new or empty folder")
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        fail(f"--out {folder}: {error.strerror}")
    return folder


def walk_with_progress(graph: Graph, request: WalkOptions, ended: Ended) -> tuple[list[Any], float]:
    """How each episode ended, and the wall seconds of all."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    text = TextColumn("{task.description} {task.fields[text]}")
    columns = (BarColumn(bar_width=12), text, TimeElapsedColumn())
    with Progress(*columns) as bar:
        task = bar.add_task("starting", total=None, text=" ".join(graph.names))

        def glance(now: Any) -> None:
            episode = f"episode {now.episode}, " if request.episodes > 1 else ""
            text = f"margin {now.margin * 1e3:.0f} mm, slack {now.slack:.2f}, force ratio {now.ratio:.2f}"
            description = f"{episode}stone {now.stone} of {now.stones},"
            bar.update(task, description=description, total=now.stones, completed=now.stone, text=text)

        return run_graph(graph, request, glance, ended)
