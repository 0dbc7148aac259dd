"""Find a gait: periodic, within the limits of robot and ground, both stone barriers kept."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import typer
from pydantic import BaseModel, ConfigDict, Field
from rabbit_common.options import Given, fail, options
from rabbit_common.own_folder import own_folder

from rabbit_gait_design.specification import GaitSpecification

NOT_FOUND = 1

app = typer.Typer(add_completion=False)


class FolderOptions(BaseModel):
    """Options of `rabbit gait` besides those of the specification."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    out: Path = Field(Path("runs/gaits"), description="folder for NAME.yaml, NAME.png and the payload table")
    payload_table: tuple[float, ...] = Field(
        tuple(float(kg) for kg in range(0, 73, 8)), description="payloads to report on, kg; '' for none"
    )
    library: tuple[float, ...] = Field((), description="step lengths of a gait library, m, increasing; '' for one gait")
    library_slopes: tuple[float, ...] = Field(
        (), description="rises of the ground that the library has gaits for, degrees, increasing; '' for --slope alone"
    )
    speed_slope: float = Field(
        0.0, ge=-2, le=2, description="of a library: m/s by which the speed grows with each m of step length"
    )


@app.command()
@options(FolderOptions, GaitSpecification)
def gait(given: Given) -> None:
    """Find a gait: periodic, within the limits of robot and ground, both stone barriers kept along it."""
    specification, folder = given.build(GaitSpecification), given.build(FolderOptions)
    from rich.console import Console

    from rabbit_gait_design.design import GaitDesignError
    from rabbit_gait_design.runner import run, run_library

    own_folder(folder.out, "gait")
    console = Console()
    try:
        with console.status("IPOPT begins") as status:

            def progress(of: str = "") -> Callable[[int, float, float], None]:
                return lambda *at: status.update(of + progress_text(*at))

            if folder.library:
                made = run_library(
                    specification,
                    folder.library,
                    folder.out,
                    folder.speed_slope,
                    folder.library_slopes,
                    lambda name: progress(f"{name}: "),
                )
                show_library(made, console)
            else:
                show(*run(specification, folder.out, progress(), folder.payload_table), console)
    except ValueError as error:
        fail(f"--library: {error}")
    except GaitDesignError as error:
        fail(error, NOT_FOUND)
    except OSError as error:
        fail(f"--out {folder.out}: {error.strerror}")
    for suffix in ("yaml", "png"):
        print(f"written {folder.out / specification.name}.{suffix}")


def progress_text(iteration: int, cost: float, violation: float) -> str:
    """What the screen says while IPOPT works."""
    return f"iteration {iteration}: cost {cost:.4g}, constraints broken by {violation:.1e}"


def show_library(made: Any, console: Any) -> None:
    """A row a gait."""
    from rich.table import Table

    columns = ("speed", "step_time", "peak_torque", "friction_used", "least_normal_force", "foot_height", "eigenvalue")
    table = Table("step (m)", "slope (degrees)", *columns)
    for gait in made.gaits:
        place = f"{gait.step_length:g}", f"{gait.slope:g}"
        table.add_row(*place, *(f"{gait.metadata['figures'][name]:.3g}" for name in columns))
    console.print(table)


def show(made: Any, reports: Sequence[Any], console: Any) -> None:
    """Figures of the gait, and under payload."""
    from rich.table import Table

    for name, value in made.metadata["figures"].items():
        console.print(f"{name:>24} {value:.4g}", highlight=False)
    if reports:
        table = Table("payload (kg)", "phase rate (1/s)", "least (1/s)", "eigenvalue", "peak torque (N m)")
        for report in reports:
            figures = (report.phase_rate, report.least_phase_rate, report.eigenvalue, report.peak_torque)
            table.add_row(f"{report.payload:g}", *(f"{f:.3g}" if math.isfinite(f) else "-" for f in figures))
        console.print(table)
