"""Walk in real time: late ticks, missed deadlines, the age of the torque, with busy neighbours."""

import itertools
from collections.abc import Callable
from datetime import datetime
from pathlib import Path
from typing import Annotated, Any

import typer
from pydantic import Field
from rabbit_bringup.commands.walk import DEFAULTS
from rabbit_common.options import Given, options, tell_if_bare
from rabbit_common.own_folder import new_folder
from rabbit_experiments.commands.evaluate import given_assembly
from rabbit_experiments.conditions import TuningOptions
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters

NOT_FIT = 1

app = typer.Typer(add_completion=False)


class JitterOptions(TuningOptions):
    """Options of `rabbit jitter` besides those of plant and controller."""

    out: Path | None = Field(None, description="folder for recordings and figures (default: runs/DATE-jitter)")
    minutes: float = Field(10.0, gt=0, le=1000, description="length of each walk, minutes")
    neighbours: tuple[Annotated[int, Field(ge=0, le=1000)], ...] = Field(
        (0,), min_length=1, description="numbers of busy processes beside a walk, a walk for each"
    )
    priority: tuple[Annotated[int, Field(ge=0, le=99)], ...] = Field(
        (0,), min_length=1, description="SCHED_FIFO priorities of simulator and controller, a walk for each; 0: none"
    )
    seed: int = Field(1, ge=0, le=2**63 - 1, description="seed of the first episode")
    policy: str | None = Field(None, description="zero, a shipped policy or a file")


@app.command()
@options(JitterOptions, ControllerParameters, SimulationParameters, defaults=DEFAULTS)
def jitter(given: Given, context: typer.Context) -> None:
    """Walk in real time: late ticks, missed deadlines, age of the torque. Exit code 1 if this machine is not fit."""
    request = given.build(JitterOptions)
    tell_if_bare(
        context, f"A walk of {request.minutes:g} minutes in real time. To begin:", "rabbit jitter --minutes 10"
    )
    assembly = given_assembly(given, request.policy, request.parameters, oracle=False)
    folder = new_folder(request.out or Path("runs") / f"{datetime.now():%Y%m%d-%H%M%S}-jitter")
    from rabbit_recording import RecordingError

    from rabbit_campaigns.figures import print_table, under_way, write_figures
    from rabbit_campaigns.jitter import LATE_LIMIT, walk_beside

    cases = []
    with under_way(folder, RecordingError) as show_status:
        for case in itertools.product(request.neighbours, request.priority):
            cases.append(walk_beside(assembly, folder, request.seed, *case, request.minutes * 60, show_status))
            write_figures(folder / "jitter.json", {"cases": cases, "seed": request.seed})
    head = ("times in ms", *(f"{row['neighbours']} neighbours" for row in cases))
    print_table(head, [(name, *map(line, cases)) for name, line in LINES.items()])
    print(f"written to {folder}")
    if any(row["late_share"] > LATE_LIMIT for row in cases):
        raise typer.Exit(NOT_FIT)


LINES: dict[str, Callable[[dict[str, Any]], str]] = {
    "SCHED_FIFO": lambda row: str(row["priority"] or "no"),
    "load before": lambda row: f"{row['load_before']:.1f}",
    "ticks": lambda row: str(row["ticks"]),
    "more than 2 ms late": lambda row: f"{row['late_share']:.3%}",
    "late: p99, max": lambda row: f"{row['late_ms']['p99']:.2f}, {row['late_ms']['max']:.1f}",
    "answer: median, p99": lambda row: f"{row['response_ms']['p50']:.1f}, {row['response_ms']['p99']:.1f}",
    "age of the torque: p99, max": lambda row: f"{row['age_ms']['p99']:.1f}, {row['age_ms']['max']:.1f}",
    "ticks not answered in time": lambda row: f"{row['missed']}, {row['damped']} of them damped",
    "walked": lambda row: f"{row['outcomes'].get('walked', 0)} of {row['episodes']}",
    "ticks lost": lambda row: str(row["lost"]),
}
