"""Measure the scales of alpha, beta and their error on a few walks, and write them into a controller's file."""

import re
from pathlib import Path

import typer
from pydantic import Field
from rabbit_common.options import Defaults, Given, complaints, fail, going_on_from, options
from rabbit_common.own_folder import own_folder
from rabbit_description.atomic_file import replace_text
from rabbit_description.bounded_file import is_file
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters

from rabbit_experiments.conditions import TRAINING_PLANT, TRAINING_SLACK_WEIGHT, RunnerOptions, TuningOptions

DEFAULTS = Defaults(always={"slack_weight": TRAINING_SLACK_WEIGHT, **TRAINING_PLANT})
LINE = re.compile(r"^(SCALES\b[^=\n]*= ).*$", re.MULTILINE)

app = typer.Typer(add_completion=False)


class ScalesOptions(RunnerOptions, TuningOptions):
    """Options of `rabbit scales` besides those of plant and controller."""

    into: Path | None = Field(None, description="Python file, whose line SCALES = ... is written anew")
    walks: int = Field(2, ge=1, le=1000, description="walks of the nominal controller, and as many of the oracle")
    seed: int = Field(1, ge=0, le=2**63 - 1, description="seed of courses and first states")
    out: Path = Field(Path("runs/scales"), description="folder of the walks; what was stopped goes on")


@app.command()
@options(ScalesOptions, ControllerParameters, SimulationParameters, defaults=DEFAULTS)
def scales(given: Given) -> None:
    """Measure the scales of alpha, beta and their error on a few walks, and write them into a controller's file."""
    from rabbit_experiments.cache import Cache, JobError
    from rabbit_experiments.commands.evaluate import given_assembly
    from rabbit_experiments.evaluation import episode_seeds
    from rabbit_experiments.measured_scales import ScalesError, measure_scales

    request = given.build(ScalesOptions)
    text = request.into.read_text(encoding="utf-8") if request.into and is_file(request.into) else ""
    lines = len(LINE.findall(text))
    if request.into and lines != 1:
        fail(f"--into {request.into}: {lines} lines that begin with SCALES and have =; expected one")
    assembly = given_assembly(given, "oracle", request.parameters)
    cache = Cache(own_folder(request.out, "scales") / "cache")
    seeds = episode_seeds(request.seed, request.walks).values()
    with complaints(JobError, ScalesError), going_on_from("the walks that are done"):
        measured = measure_scales(assembly, seeds, cache, request.who_runs)
    literal = "{" + ", ".join(f'"{name}": {values}' for name, values in measured.items()) + "}"
    print(f"SCALES = {literal}")
    if request.into:
        with complaints(OSError):
            replace_text(request.into, LINE.sub(lambda line: line[1] + literal, text))
