"""Walk many seeded runs without ROS: success, stones, forces, solver and speed."""

import json
from pathlib import Path
from typing import Any

import typer
from pydantic import Field
from rabbit_common.options import Defaults, Given, complaints, fail, options
from rabbit_description.atomic_file import replace_text
from rabbit_description.plugins import load
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters

from rabbit_experiments.conditions import ABOUT_BATCH, BATCH, EVALUATION_LAG, RunnerOptions, WalkOptions

DEFAULTS = Defaults(always={"motor_lag": EVALUATION_LAG})

app = typer.Typer(add_completion=False)


class EvaluationOptions(RunnerOptions, WalkOptions):
    """Options of `rabbit evaluate` besides those of plant and controller."""

    out: Path | None = Field(
        None, description="folder for runs.csv, violations.csv, summary.json (default: runs/evaluate-KEY, one for each)"
    )
    batch: int = Field(BATCH, ge=1, le=4096, description=ABOUT_BATCH)
    pictures: bool = Field(False, description="draw the first run")
    rerun: bool = Field(False, description="write the first run for Rerun's viewer")


@app.command()
@options(EvaluationOptions, ControllerParameters, SimulationParameters, defaults=DEFAULTS)
def evaluate(given: Given) -> None:
    """Walk many seeded runs without ROS: success rate, stones, forces, solver and speed, in DIR/summary.json."""
    request = given.build(EvaluationOptions)
    assembly = given_assembly(given, request.policy, request.parameters)
    from rabbit_experiments.evaluation import Scenario
    from rabbit_experiments.results import results_folder
    from rabbit_experiments.walk_records import RECORDS, what_walks

    print(what_walks(assembly.controller, assembly.simulation, assembly.policy), flush=True)
    scenario, about = Scenario(assembly, request.runs, request.seed), describe(assembly, request.seed)
    out = results_folder(request.out, "evaluate", about["key"])
    results, walked = walk_all(scenario, out, request.who_runs, request.batch)
    show(conclude(scenario, out, results, about))
    print(f"{walked} runs made; written {out}")
    if request.pictures or request.rerun:
        scenario.recorded.write(scenario.recorded.do(), out / RECORDS)  # the first run again, the same
    if request.pictures:
        for path in load("rabbit.pictures", "recording")(out):  # of rabbit_viewer, which imports this package
            print(f"drawn {path}")
    if request.rerun:
        with complaints(RuntimeError):
            print(f"written {load('rabbit.pictures', 'rerun')(out, job=scenario.recorded)}")


def given_assembly(given: Given, policy: str | None = None, parameters: str = "ours", oracle: bool = True) -> Any:
    """Plant, controller and policy as the command line has them; flat terrain where the controller has no stones."""
    from rabbit_description.gait import GaitError
    from rabbit_sim.stones import CourseError
    from rl_cbf_clf_controller.parameters import ParameterError, load_parameters
    from rl_cbf_clf_controller.weights import PolicyFileError

    from rabbit_experiments.assembly import Assembly, AssemblyError, resolve_policy

    given.build(ControllerParameters)  # told apart from what is wrong in the file
    with complaints(ParameterError):
        terrain = given.of(SimulationParameters).get("terrain")
        controller = load_parameters(parameters, terrain, **given.of(ControllerParameters))
    simulation = given.build(SimulationParameters, terrain=controller.terrain, tick_seconds=controller.tick_seconds)
    with complaints(GaitError, CourseError, PolicyFileError):
        try:
            assembly = Assembly(simulation, controller, resolve_policy(policy, controller, oracle))
        except AssemblyError as error:
            fail(f"--{error.option} {error}")
        assembly.build()[0].close()
    return assembly


def describe(assembly: Any, seed: int) -> dict[str, Any]:
    """What is evaluated, with the `key` that distinguishes evaluations, and what it is `made_with`."""
    from rabbit_description.gait import load_gaits

    from rabbit_experiments import provenance
    from rabbit_experiments.evaluation import Walk

    asked = provenance.plain(Walk(assembly, seed))
    return {
        "key": provenance.key_of(asked),
        "made_with": provenance.provenance(asked),
        "command": provenance.command(),
        "commit": provenance.commit(),
        "versions": provenance.versions(),
        "seed": seed,
        "policy": assembly.policy,
        "policy_version": assembly.make_policy().version,
        "gait": load_gaits(assembly.controller.gait).name,
        "parameters": {name: getattr(assembly, name).model_dump(mode="json") for name in ("controller", "simulation")},
    }


def walk_all(scenario: Any, folder: Path, processes: int | str, batch: int) -> tuple[list[Any], int]:
    """All results, and how many runs the folder lacked; its tables are kept up to date."""
    from rabbit_experiments.metrics import ForceTick, RunRow
    from rabbit_experiments.results import RUNS, VIOLATIONS, results_of
    from rabbit_experiments.summary import Walks
    from rabbit_experiments.tables import write_rows

    def note(results: list[Any]) -> str:
        write_rows(folder / VIOLATIONS, ForceTick, [tick for result in results for tick in result.violations])
        write_rows(folder / RUNS, RunRow, [result.row for result in results])
        walks = Walks([result.row for result in results])
        return f"walked {walks.walked}, mean stones {walks.mean_stones:.1f}" if results else ""

    return results_of(scenario.walks, folder, processes, note, batch)


def conclude(scenario: Any, folder: Path, results: list[Any], about: dict[str, Any]) -> dict[str, Any]:
    """Write the summary."""
    from rabbit_experiments.results import SUMMARY
    from rabbit_experiments.summary import summarise

    plant, controller = scenario.assembly.simulation, scenario.assembly.controller
    figures = summarise(results, controller.qp_solver, plant.stones, plant.tick_seconds)
    summary = {"runs": scenario.runs, "stones": plant.stones, **figures, **about}
    replace_text(folder / SUMMARY, json.dumps(summary, indent=2))
    return summary


def show(summary: dict[str, Any]) -> None:
    """The summary's head on the screen."""
    from rich.console import Console
    from rich.table import Table

    table = Table(show_header=False, title=f"{summary['runs']} runs of {summary['stones']}")
    for name in SHOWN:
        table.add_row(name, _text(summary[name]))
    Console().print(table)


SHOWN = (
    *("success_rate", "success_rate_ci95", "success_with_forces", "mean_stones", "mean_stones_ci95", "missed_stones"),
    *("falls", "rms_y", "max_force_ratio", "ticks", "ticks_over_cone", "ticks_over_cone_at_impact", "ticks_lost"),
    *("qp_unanswered_ticks", "slack_ticks", "rescue_ticks", "ecbf_start_violations"),
    *("tick_ms_p50", "tick_ms_p99", "real_time_factor"),
)


def _text(value: Any) -> str:
    if isinstance(value, float):
        return f"{value:.4g}"
    if isinstance(value, tuple | list):
        return " to ".join(map(_text, value))
    if isinstance(value, dict):
        return ", ".join(f"{name}: {count}" for name, count in value.items()) or "none"
    return str(value)
