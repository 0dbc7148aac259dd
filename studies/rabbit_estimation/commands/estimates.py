"""Errors of a policy's estimates against the oracle's."""

import json
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import Field
from rabbit_common.options import Defaults, Given, complaints, options
from rabbit_common.own_folder import new_file
from rabbit_experiments.commands.evaluate import describe, given_assembly
from rabbit_experiments.conditions import EVALUATION_LAG, TRAINING_SCALE, WalkOptions
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters

DEFAULTS = Defaults(always={"mass_scale": TRAINING_SCALE, "motor_lag": EVALUATION_LAG})

app = typer.Typer(add_completion=False)


class ErrorsOptions(WalkOptions):
    """Options of `rabbit estimates` besides those of plant and controller."""

    runs: int = Field(5, ge=1, le=10_000, description="walks of the policy, and as many of the oracle")
    out: Path | None = Field(None, description="file for the figures (.json)")


@app.command()
@options(ErrorsOptions, ControllerParameters, SimulationParameters, without=("controller", "policy"), defaults=DEFAULTS)
def estimates(
    given: Given,
    file: Annotated[Path, typer.Argument(help="policy file (.safetensors), or the name of a shipped one")],
) -> None:
    """Errors of a policy's estimates against the oracle's, on walks of both (by default at twice the mass)."""
    request = given.build(ErrorsOptions)
    if request.out:
        new_file(request.out)
    from rabbit_description.atomic_file import replace_text
    from rabbit_experiments.evaluation import episode_seeds
    from rich.progress import track
    from rl_cbf_clf_controller.weights import PolicyFileError, policy_path, read

    from rabbit_estimation.policy_errors import NoTicksError, compare

    with complaints(PolicyFileError):
        given = given.over({"controller": read(policy_path(str(file))).metadata.problem})
    assembly = given_assembly(given, str(file), request.parameters)
    seeds = episode_seeds(request.seed, request.runs).values()
    with complaints(NoTicksError):
        by_walker = {who: compare(assembly, who, track(seeds, f"walks of the {who}")) for who in ("policy", "oracle")}
    for walker, figures in by_walker.items():
        show(walker, figures)
    if request.out:
        text = json.dumps({"on_walks_of": by_walker, **describe(assembly, request.seed)}, indent=2)
        request.out.parent.mkdir(parents=True, exist_ok=True)
        replace_text(request.out, text)
        print(f"written to {request.out}")


def show(walker: str, figures: dict[str, Any]) -> None:
    """A table on the screen."""
    from rich.console import Console
    from rich.table import Table

    names = list(next(iter(figures["quantities"].values())))
    walked = sum(walk["outcome"] == "walked" for walk in figures["walks"])
    title = f"walks of the {walker}: {walked} of {len(figures['walks'])} to the end, {figures['ticks']} ticks"
    active = ", ".join(f"{row} {share:.1%}" for row, share in figures["active_share"].items())
    table = Table("", *names, title=title, caption=f"active: {active}")
    for quantity, errors in figures["quantities"].items():
        table.add_row(quantity, *("-" if value is None else f"{value:.4g}" for value in errors.values()))
    Console().print(table)
