"""Train the field's methods that this project is compared with: end-to-end RL, GPs."""

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from rabbit_common.exit_codes import of_interrupt
from rabbit_common.options import complaints, fail, tell_if_bare
from rabbit_common.own_folder import new_file, own_folder

if TYPE_CHECKING:
    from rabbit_rivals.session import Options

app = typer.Typer(add_completion=False, no_args_is_help=True, help=__doc__)

Out = Annotated[Path, typer.Option(help="new file (.safetensors)")]
Seed = Annotated[int, typer.Option(min=0, max=2**31, help="seed of the training")]


@app.command()
def end_to_end(
    context: typer.Context,
    out: Annotated[Path, typer.Option(help="folder of the session; one that was stopped there goes on")] = Path(
        "runs/end-to-end"
    ),
    learner: Annotated[Literal["ppo", "sac", "dagger"], typer.Option(help="how it learns")] = "ppo",
    ticks: Annotated[int, typer.Option(min=1, max=10**11, help="ticks of all robots together")] = 20_000_000,
    seed: Seed = 1,
    robots: Annotated[int, typer.Option(min=4, max=4096, help="robots that walk side by side")] = 128,
) -> None:
    """Train joint targets by PPO, SAC or DAgger in MuJoCo, over random plants: DIR/policy.safetensors and a curve."""
    from rabbit_rivals.end_to_end import LEARNERS, train
    from rabbit_rivals.session import Options

    options = Options(learner, ticks, seed, robots, **LEARNERS[learner])
    in_session(context, "rival end-to-end", options, out, train)


def in_session(
    context: typer.Context, command: str, options: "Options", out: Path, train: "Callable[[Options, Path], Path]"
) -> None:
    """What a `command` that trains in a session does."""
    from rabbit_rivals.session import SessionError

    tell_if_bare(
        context,
        f"{options.ticks:,} ticks, hours; a session that is stopped goes on. To begin:",
        f"rabbit {command} --ticks {options.ticks}",
    )
    own_folder(out, command)
    try:
        with complaints(SessionError):
            print(f"written {train(options, out)}")
    except KeyboardInterrupt as stop:
        fail("stopped; the same command goes on from the last line of the curve", code=of_interrupt(stop))


@app.command()
def task(
    task: Annotated[str, typer.Argument(help="a .py file with a ControlTask, or an entry point in rabbit.systems")],
    out: Out,
    ticks: Annotated[int, typer.Option(min=1, max=10**11, help="ticks of all rides together")] = 1_000_000,
    seed: Seed = 1,
) -> None:
    """Train a system of your own end to end by PPO; then rabbit evaluate --task TASK --controller ppo:FILE."""
    from rabbit_description.task import TaskError
    from rabbit_description.task_source import load_task

    from rabbit_rivals import task_policy

    new_file(out)
    with complaints(TaskError):
        loaded = load_task(task)
    with complaints(ValueError, OSError):
        task_policy.train(loaded, ticks, seed).write(out)
    print(f"written {out}")


@app.command()
def gp(
    session: Annotated[Path, typer.Argument(help="folder that rabbit train filled")],
    out: Out,
    inducing: Annotated[int, typer.Option(min=1, max=2000, help="transitions that span each Gaussian process")] = 300,
    seed: Seed = 1,
) -> None:
    """Fit Gaussian processes for the cone programme to the transitions of a training session."""
    from rl_trainer.checkpoint import CheckpointError

    from rabbit_rivals.gp_fit import fit_session

    new_file(out)
    with complaints(CheckpointError):
        file = fit_session(session, inducing, seed)
    file.write(out)
    print(f"{file.about.transitions} transitions; written {out}")
