"""Walk through the node graph: simulator, controller, trainer, recorder."""

from collections.abc import Callable
from datetime import datetime
from functools import partial
from importlib.util import find_spec
from math import isfinite
from pathlib import Path
from typing import Any

import typer
from rabbit_common import exit_codes
from rabbit_common.executables import LaunchError, find_executable
from rabbit_common.options import Defaults, Given, complaints, fail, option_name, options
from rabbit_common.own_folder import new_folder
from rabbit_description.atomic_file import first_free
from rabbit_experiments.commands.evaluate import given_assembly
from rabbit_experiments.conditions import EVALUATION_LAG, TRAINING_SCALE
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters

from rabbit_bringup.launching.walk import NOBODY, WalkOptions, WalkSettings

MODELS = (WalkOptions, ControllerParameters, SimulationParameters)
RARE = ("swap_at", "priority", "view_port", "ready_timeout", "log_level")  # in --help-all alone
DEFAULTS = Defaults(
    always={"motor_lag": EVALUATION_LAG}, bare={"controller": "rl-cbf-clf-qp", "mass_scale": TRAINING_SCALE}
)

app = typer.Typer(add_completion=False)


@app.command(epilog=exit_codes.EPILOG)
@options(*MODELS, defaults=DEFAULTS, rare=RARE)
def walk(given: Given) -> None:
    """Walk through the node graph: simulator, controller, trainer, recorder."""
    walk = prepare(given)
    from rabbit_bringup.launching.walk_report import carry_out

    raise typer.Exit(carry_out(walk, partial(walk_with_progress, walk)))


def prepare(given: Given) -> WalkSettings:
    """The walk that is asked for; makes its folder. Ends the command if it cannot be."""
    options = with_usable_trainer(given.build(WalkOptions), given)
    if options.task:
        return walk_of_task(options, given)
    if options.is_foreign:
        options, given = with_foreign_controller(options, given)
    assembly = given_assembly(given, options.policy, options.parameters, oracle=False)  # no node sees the true plant
    training = given_training(options, assembly.controller, assembly.policy) if options.trainer else {}
    walk = WalkSettings.of(assembly, make_folder(options), options, training=training)
    if not options.is_foreign:
        from rabbit_experiments.walk_records import what_walks

        print(what_walks(assembly.controller, assembly.simulation, assembly.policy), flush=True)
    if options.view:
        port = options.view_port
        print(f"open http://127.0.0.1:{port} in a browser" if port else "the page: see log/viewer.log")
    return walk


def with_usable_trainer(options: WalkOptions, given: Given) -> WalkOptions:
    """Leaves the trainer out where torch is not installed.

    Raises `ModuleNotFoundError`, which becomes a line, if the trainer was asked for.
    """
    if not options.trainer or find_spec("torch"):
        return options
    if given.values.keys() & {"trainer", "swap_at"}:
        raise ModuleNotFoundError(name="torch")
    print("torch is not installed: the walk goes without the trainer")
    return options.model_copy(update={"trainer": False})


def walk_of_task(options: WalkOptions, given: Given) -> WalkSettings:
    """The walk of a control task, which brings plant and controllers."""
    from rabbit_description.task import TaskError
    from rabbit_description.task_source import load_task
    from rl_cbf_clf_controller.task_controller import NOMINAL, TaskController

    if of_robot := sorted(set(given.values) - set(WalkOptions.model_fields)):
        fail(f"{option_name(of_robot[0])} beside --task: expected options of the walk alone")
    if "controller" in given.values and not options.is_foreign:
        fail(f"--controller {options.controller} beside --task: expected --policy")
    if options.view:
        fail("--view beside --task: expected `rabbit play --task`")
    policy = options.policy or NOMINAL
    with complaints(TaskError):
        TaskController(load_task(options.task)).controlling(policy)
    whole = options.model_copy(update={"task": str(Path(options.task).absolute())})
    parts = {"simulation": SimulationParameters(), "controller": ControllerParameters()}
    return WalkSettings(folder=make_folder(options), options=whole, policy=policy, **parts)


def with_foreign_controller(options: WalkOptions, given: Given) -> tuple[WalkOptions, Given]:
    """Options of a walk with a controller of another kind, from which our trainer cannot learn; what plant is given.

    Of our controllers one that needs no policy stands for it, where a gait and a terrain are chosen.
    """
    if options.controller != NOBODY:
        package, _, executable = options.controller.partition("/")
        with complaints(LaunchError):
            find_executable(package, executable)
    ours = "clf-qp" if given.values.get("terrain") == "flat" else "cbf-clf-qp"
    return options.model_copy(update={"trainer": False}), Given({**given.values, "controller": ours}, given.defaults)


def given_training(request: WalkOptions, controller: ControllerParameters, policy: str) -> dict[str, Any]:
    """The trainer's parameters for this problem, and of a policy file that it goes on from."""
    from rl_cbf_clf_controller.kinds import find_problem
    from rl_cbf_clf_controller.uncertainty import STEP_LENGTH
    from rl_cbf_clf_controller.weights import read
    from rl_trainer.parameters import TrainingParameters

    known: dict[str, Any] = {name: getattr(controller, name) for name in ("problem", "tick_seconds")}
    known["seed"] = request.seed
    if policy != "zero":
        form = read(Path(policy)).metadata
        known |= {name: getattr(form, name) for name in ("structured", "alpha_scale", "beta_scale")}
        known |= {
            "observe_l_min": set(find_problem(form.problem).omissible) <= set(form.observation),
            "observe_step_length": STEP_LENGTH in form.observation,
            "hidden1": form.hidden[0],
            "hidden2": form.hidden[1],
        }
    with complaints():
        return TrainingParameters(**known).model_dump(mode="json")


def make_folder(request: WalkOptions) -> Path:
    """The walk's folder, new."""
    if request.out:
        return new_folder(request.out)
    return new_folder(first_free(Path("runs", f"{datetime.now():%Y%m%d-%H%M%S}-seed-{request.seed}")))


def walk_with_progress(walk: WalkSettings, ended: Callable[[Any], None]) -> Any:
    """Walk under a bar that says how it goes; returns the monitor."""
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from rabbit_bringup.ros.walk_monitor import walk_through

    def show(now: Any) -> None:
        episode = f"episode {now.episode}, " if walk.options.episodes > 1 else ""
        done = f"{now.ticks} ticks" if walk.options.task else f"stone {now.stone} of {now.stones},"
        bar.update(task, description=episode + done, total=now.stones, completed=now.stone, text=figures_of(now))

    said = TextColumn("{task.description} {task.fields[text]}")
    with Progress(BarColumn(bar_width=12), said, TimeElapsedColumn()) as bar:
        task = bar.add_task("starting", total=None, text=" ".join(walk.names))
        return walk_through(walk, ended, show)


def figures_of(now: Any) -> str:
    """What a `Progress` says beside its stones: of its figures those that are known."""
    from rl_cbf_clf_controller.message_fields import STONE_BARRIERS

    figures = [(f"margin {now.margin * 1e3:.0f} mm", now.margin)]
    figures += [(f"{name} {B:.3f}", B) for name, B in now.barriers.items() if name not in STONE_BARRIERS]
    figures += [(f"slack {now.slack:.2f}", now.slack), (f"force ratio {now.ratio:.2f}", now.ratio)]
    return ", ".join(text for text, value in figures if isfinite(value))
