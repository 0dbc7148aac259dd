"""Learn a policy in process."""

from contextlib import suppress
from pathlib import Path
from typing import Any

import typer
from pydantic import Field
from rabbit_common.options import Defaults, Given, complaints, going_on_from, options
from rabbit_common.own_folder import own_folder
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters
from rl_trainer.parameters import PAPER_LITERAL, TrainingParameters

from rabbit_experiments.conditions import POLICY, TRAINING_PLANT, TRAINING_SLACK_WEIGHT, TuningOptions

DEFAULTS = Defaults(always={"slack_weight": TRAINING_SLACK_WEIGHT, **TRAINING_PLANT})

app = typer.Typer(add_completion=False)


class SessionOptions(TuningOptions):
    """Options of `rabbit train` besides those of learner, controller and plant."""

    out: Path = Field(Path("runs/train"), description="folder of the session; one that was stopped there goes on")
    paper_literal: bool = Field(False, description="DDPG as the paper states it, in place of the one that works")


@app.command()
@options(
    SessionOptions,
    TrainingParameters,
    ControllerParameters,
    SimulationParameters,
    without=("controller",),
    defaults=DEFAULTS,
)
def train(given: Given) -> None:
    """Learn a policy on the perturbed plant (by default twice the mass, no motor lag; no end at a missed stone)."""
    request = given.build(SessionOptions)
    from rabbit_description.gait import GaitError
    from rabbit_sim.stones import CourseError
    from rl_cbf_clf_controller.parameters import ParameterError, load_parameters
    from rl_cbf_clf_controller.scene import ControllerError
    from rl_trainer.checkpoint import CheckpointError
    from rl_trainer.training import DivergenceError

    from rabbit_experiments.training_setup import training

    parameters = given.build(TrainingParameters, **(PAPER_LITERAL if request.paper_literal else {}))
    with complaints(ParameterError):
        values = given.of(ControllerParameters, but=("controller", "sigma"))
        controller = load_parameters(request.parameters, **values, controller=parameters.problem.name)
    plant = given.build(SimulationParameters, terrain=controller.terrain, stones=parameters.walking_steps)
    own_folder(request.out, "train")
    with (
        complaints(GaitError, CourseError, CheckpointError, DivergenceError, ControllerError),
        training(request.out, parameters, controller, plant) as (trainer, reports),
    ):
        try:
            with going_on_from("the last whole episode"):
                follow(trainer, reports)
        finally:
            draw_curve(request.out)
        trainer.policy_file().write(request.out / POLICY)
    print(f"written {request.out / POLICY}")


def draw_curve(folder: Path) -> None:
    """Draw the curve of what was trained, if anything was and rabbit_viewer, which draws, is there."""
    from rabbit_description.plugins import load
    from rl_trainer.checkpoint import CURVE

    if (folder / CURVE).is_file():
        with suppress(LookupError), complaints(OSError):
            print(f"drawn {load('rabbit.pictures', 'curve')(folder)}")


def follow(trainer: Any, reports: Any) -> None:
    """A bar with the newest episode's figures while the session runs."""
    from rabbit_experiments.engine import progress_bar

    with progress_bar() as progress:
        task = progress.add_task("walking", total=trainer.parameters.episodes, completed=trainer.episode)
        for report in reports:
            reward = " ".join(f"{name} {value:.3g}" for name, value in report.reward.items())
            losses = " ".join(f"{name} {value:.3g}" for name, value in report.losses.items())
            text = f"steps {report.steps}, ticks {report.ticks}, reward {reward}, losses {losses or '-'}"
            progress.update(task, advance=1, description=f"steps {report.steps}, ticks {report.ticks}")
            progress.console.print(f"episode {report.episode + 1:3d}  {text}", highlight=False, soft_wrap=True)
