"""Walk many seeded runs without ROS: success, stones, forces, solver and speed."""

import os
from pathlib import Path
from typing import Any

import typer
from pydantic import BaseModel, ConfigDict, Field
from rabbit_cli.options import Defaults, Given, complaints, fail, options
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters

from rabbit_experiments.conditions import EVALUATION_LAG

DEFAULTS = Defaults(always={"motor_lag": EVALUATION_LAG})

app = typer.Typer(add_completion=False)


class EvaluationOptions(BaseModel):
    """What `rabbit evaluate` is told besides plant and controller."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    out: Path = Field(description="folder for runs.csv, violations.csv, summary.json")
    runs: int = Field(10, ge=1, le=1_000_000, description="number of runs")
    seed: int = Field(9001, ge=0, le=2**63 - 1, description="of courses, first states and sensor noise")
    policy: str | None = Field(
        None, description="zero, oracle, a shipped policy or a file; a controller that learns has its own by default"
    )
    nominal: tuple[str, ...] = Field((), description="quantities whose estimates are set to zero, such as V,B2")
    parameters: str = Field("ours", description="of the controller: ours, authors or a YAML file")
    jobs: int = Field(
        default_factory=lambda: os.cpu_count() or 1, ge=1, le=4096, description="processes (default: all cores)"
    )
    pictures: bool = Field(False, description="draw the first run")
    overwrite: bool = Field(False, description="begin anew in a folder that holds another evaluation")


@app.command()
@options(EvaluationOptions, ControllerParameters, SimulationParameters, defaults=DEFAULTS)
def evaluate(given: Given) -> None:
    """Walk many seeded runs without ROS: success rate, stones, forces, solver and speed, in DIR/summary.json."""
    request = given.build(EvaluationOptions)
    assembly = given_assembly(given, request.policy, request.parameters, request.nominal)
    from rabbit_experiments.results import ResultsError, ResultsFolder

    key, about = describe(assembly, request.seed)
    with complaints(ResultsError):
        folder = ResultsFolder(request.out, {"key": key, **about}, request.overwrite)
    try:
        run(assembly, request, folder)
    except KeyboardInterrupt:
        fail(f"stopped after {len(folder.results)} runs; the same command goes on from there", code=130)
    summary = conclude(assembly, request, folder, about)
    show(summary, request.out)
    if request.pictures:
        draw_first(assembly, request)


def given_assembly(
    given: Given, policy: str | None = None, parameters: str = "ours", nominal: tuple[str, ...] = ()
) -> Any:
    """Plant, controller and policy as the command line has them; flat terrain where the controller has no stones."""
    from rabbit_description.gait import GaitError
    from rabbit_sim.stones import CourseError
    from rl_cbf_clf_controller.parameters import ParameterError, load_parameters
    from rl_cbf_clf_controller.weights import PolicyFileError

    from rabbit_experiments.assembly import Assembly, AssemblyError, resolve_policy

    given.build(ControllerParameters)  # told apart from what is wrong in the file
    with complaints(ParameterError):
        controller = load_parameters(parameters, **given.of(ControllerParameters))
    simulation = given.build(SimulationParameters, terrain=controller.terrain)
    with complaints(GaitError, CourseError, PolicyFileError):
        try:
            assembly = Assembly(simulation, controller, resolve_policy(policy, controller), nominal)
        except AssemblyError as error:
            fail(f"--{error.option} {error}")
        assembly.build()[0].close()
    return assembly


def describe(assembly: Any, seed: int) -> tuple[str, dict[str, Any]]:
    """The key that tells evaluations apart, and what goes into the summary with it."""
    from rabbit_experiments import provenance

    identity = {**assembly.identity(), "seed": seed}
    about = {
        "command": provenance.command(),
        "commit": provenance.commit(),
        "code": provenance.code_hash(),
        "versions": provenance.versions(),
        "seed": seed,
        "policy": assembly.policy,
        "policy_version": identity["policy_version"],
        "gait": identity["gait"]["name"],
        "parameters": {"controller": identity["controller"], "simulation": identity["simulation"]},
    }
    key = provenance.content_key({**identity, "code": about["code"], "versions": about["versions"]})
    return key, about


def run(assembly: Any, request: EvaluationOptions, folder: Any) -> None:
    """Walk the runs that the folder does not have yet."""
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from rabbit_experiments.evaluation import episode_seeds, evaluate

    seeds = episode_seeds(request.seed, request.runs)
    left = {number: seed for number, seed in seeds.items() if number not in folder.results}
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeElapsedColumn())
    with Progress(*columns) as progress:
        task = progress.add_task(progress_text(folder), total=request.runs, completed=request.runs - len(left))
        for result in evaluate(assembly, left, request.jobs):
            folder.add(result)
            progress.update(task, advance=1, description=progress_text(folder))


def progress_text(folder: Any) -> str:
    """What the bar says of the runs so far."""
    rows = [result.row for result in folder.results.values()]
    if not rows:
        return "walking"
    return f"walked {sum(row.success for row in rows)}, mean stones {sum(r.stones for r in rows) / len(rows):.1f}"


def conclude(assembly: Any, request: EvaluationOptions, folder: Any, about: dict[str, Any]) -> dict[str, Any]:
    """Write the summary."""
    from rabbit_experiments.summary import summarise

    summary = summarise(folder.first(request.runs), assembly.controller.qp_solver)
    summary = {"runs": request.runs, "stones": assembly.simulation.stones, **summary, **about}
    folder.write_summary(summary)
    return summary


def show(summary: dict[str, Any], out: Path) -> None:
    """The summary's head on the screen."""
    from rich.console import Console
    from rich.table import Table

    table = Table(show_header=False, title=f"{summary['runs']} runs of {summary['stones']}")
    for name in SHOWN:
        table.add_row(name, _text(summary[name]))
    console = Console()
    console.print(table)
    console.print(f"written to {out}", highlight=False)


def draw_first(assembly: Any, request: EvaluationOptions) -> None:
    """Walk the first run again, the same, and leave its records and pictures."""
    from rabbit_viewer.walk_pictures import draw_pictures
    from rabbit_viewer.walk_records import RECORDS, save_records

    from rabbit_experiments.evaluation import episode_seeds, record_walk

    walk = record_walk(assembly, episode_seeds(request.seed, 1)[0])
    save_records(walk, request.out / RECORDS)
    for path in draw_pictures(request.out):
        print(f"drawn {path}")


SHOWN = (
    "success_rate",
    "success_rate_ci95",
    "success_with_forces",
    "mean_stones",
    "mean_stones_ci95",
    "missed_stones",
    "falls",
    "rms_y",
    "max_force_ratio",
    "ticks",
    "ticks_over_cone",
    "ticks_over_cone_at_impact",
    "ticks_lost",
    "qp_unanswered_ticks",
    "slack_ticks",
    "rescue_ticks",
    "ecbf_start_violations",
    "tick_ms_p50",
    "tick_ms_p99",
    "real_time_factor",
)


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, tuple | list):
        return " to ".join(map(_text, value))
    if isinstance(value, dict):
        return ", ".join(f"{name}: {count}" for name, count in value.items()) or "none"
    return str(value)
