"""Train the field's methods that the benchmark compares with: end-to-end RL, GPs."""

from pathlib import Path
from typing import Annotated, Literal

import typer
from rabbit_common.exit_codes import of_interrupt
from rabbit_common.options import complaints, fail
from rabbit_common.own_folder import new_file, own_folder

app = typer.Typer(add_completion=False, no_args_is_help=True, help=__doc__)

Out = Annotated[Path, typer.Option(help="file to write, .safetensors")]
Seed = Annotated[int, typer.Option(min=0, max=2**31)]


@app.command()
def end_to_end(
    out: Annotated[Path, typer.Option(help="folder; a session that was stopped there goes on")],
    learner: Annotated[Literal["ppo", "sac"], typer.Option(help="of stable-baselines3")] = "ppo",
    steps: Annotated[int, typer.Option(min=1, max=10**10, help="ticks in all")] = 1_000_000,
    seed: Seed = 1,
    mass_scale: Annotated[float, typer.Option(min=0.1, max=10, help="of the robot that it learns on")] = 2.0,
) -> None:
    """Joint targets by PPO or SAC, in MuJoCo; DIR has the learning curve and the best policy."""
    _needs_stable_baselines3()
    from rabbit_rivals.end_to_end import EndToEndOptions, SessionError, train

    own_folder(out, "rival end-to-end")
    options = EndToEndOptions(learner=learner, steps=steps, seed=seed, mass_scale=mass_scale)
    try:
        with complaints(SessionError):
            print(f"written {train(options, out)}")
    except KeyboardInterrupt as stop:
        fail("stopped; the same command goes on from the last line of the curve", code=of_interrupt(stop))


@app.command()
def gp(
    session: Annotated[Path, typer.Argument(help="folder that rabbit train filled")],
    out: Out,
    inducing: Annotated[int, typer.Option(min=1, max=2000, help="transitions that span each GP")] = 300,
    seed: Seed = 1,
) -> None:
    """Gaussian processes for the cone programme, from the transitions of a training session."""
    from rl_trainer.checkpoint import CheckpointError

    from rabbit_rivals.gp_fit import fit_session

    new_file(out)
    with complaints(CheckpointError):
        file = fit_session(session, inducing, seed)
    file.write(out)
    print(f"{file.about.transitions} transitions; written {out}")


def _needs_stable_baselines3() -> None:
    """End the command where it is not installed."""
    from importlib.util import find_spec

    if not find_spec("stable_baselines3"):
        fail("expected stable-baselines3: pip install stable-baselines3")
