"""Train the policy within the step."""

from pathlib import Path
from typing import Annotated, Literal

import typer

from rabbit_rivals.commands.rival import Seed, in_session

app = typer.Typer(add_completion=False)


@app.command()
def residual(
    context: typer.Context,
    out: Annotated[Path, typer.Option(help="folder of the session; one that was stopped there goes on")] = Path(
        "runs/residual"
    ),
    learner: Annotated[Literal["ppo", "sac"], typer.Option(help="how it learns")] = "ppo",
    ticks: Annotated[int, typer.Option(min=1, max=10**11, help="ticks of all robots together")] = 6_000_000,
    seed: Seed = 1,
    robots: Annotated[int, typer.Option(min=4, max=4096, help="robots that walk side by side")] = 128,
    flat: Annotated[float, typer.Option(min=0, max=1, help="share of the robots that walk on flat ground")] = 0.25,
) -> None:
    """Train the policy within the step in MuJoCo, over random plants: DIR/policy.safetensors and a curve."""
    from rabbit_rivals.residual import LEARNERS, train
    from rabbit_rivals.session import Options

    in_session(context, "residual", Options(learner, ticks, seed, robots, flat=flat, **LEARNERS[learner]), out, train)
