"""Train the policy within the step."""

from pathlib import Path
from typing import Annotated, Literal

import typer
from rabbit_common.exit_codes import of_interrupt
from rabbit_common.options import complaints, fail, tell_if_bare
from rabbit_common.own_folder import own_folder

app = typer.Typer(add_completion=False)


@app.command()
def residual(
    context: typer.Context,
    out: Annotated[Path, typer.Option(help="folder of the session; one that was stopped there goes on")] = Path(
        "runs/residual"
    ),
    learner: Annotated[Literal["ppo", "sac"], typer.Option(help="how it learns")] = "ppo",
    ticks: Annotated[int, typer.Option(min=1, max=10**11, help="ticks of all robots together")] = 6_000_000,
    seed: Annotated[int, typer.Option(min=0, max=2**31, help="seed of the training")] = 1,
    robots: Annotated[int, typer.Option(min=4, max=4096, help="robots that walk side by side")] = 128,
    flat: Annotated[float, typer.Option(min=0, max=1, help="share of the robots that walk on flat ground")] = 0.25,
) -> None:
    """Train the policy within the step in MuJoCo, over random plants: DIR/policy.safetensors and a curve."""
    from rabbit_rivals.residual import LEARNERS, train
    from rabbit_rivals.session import Options, SessionError

    tell_if_bare(
        context,
        f"{ticks:,} ticks, hours; a session that is stopped goes on. To begin:",
        f"rabbit residual --ticks {ticks}",
    )
    own_folder(out, "residual")
    try:
        with complaints(SessionError):
            print(f"written {train(Options(learner, ticks, seed, robots, flat=flat, **LEARNERS[learner]), out)}")
    except KeyboardInterrupt as stop:
        fail("stopped; the same command goes on from the last line of the curve", code=of_interrupt(stop))
