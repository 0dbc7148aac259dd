"""Find a gait: periodic, within the limits of robot and ground, both stone barriers kept."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import typer
from pydantic import Field
from rabbit_common.options import Given, fail, going_on_from, options
from rabbit_common.own_folder import own_folder
from rabbit_experiments.conditions import RunnerOptions

from rabbit_gait_design.specification import GaitSpecification

NOT_FOUND = 1
SHOWN = "cost", "peak_torque", "friction_used", "least_normal_force", "foot_height", "eigenvalue"  # of a library

app = typer.Typer(add_completion=False)


class FolderOptions(RunnerOptions):
    """Options of `rabbit gait` besides those of the specification; the runs are a library's searches."""

    out: Path = Field(Path("runs/gaits"), description="folder for NAME.yaml and NAME.png")
    library: tuple[float, ...] = Field((), description="step lengths of a gait library, m, increasing; '' for one gait")
    library_slopes: tuple[float, ...] = Field(
        (), description="rises of the ground that the library has gaits for, degrees, increasing; '' for --slope alone"
    )
    speed_slope: float = Field(
        0.0, ge=-2, le=2, description="growth of a library's speed with its step length, m/s for each m"
    )


@app.command()
@options(FolderOptions, GaitSpecification)
def gait(given: Given) -> None:
    """Find a gait: periodic, within the limits of robot and ground, both stone barriers kept along it."""
    specification, folder = given.build(GaitSpecification), given.build(FolderOptions)
    from rabbit_experiments.cache import Cache, JobError
    from rich.console import Console

    from rabbit_gait_design.design import GaitDesignError, design_gait
    from rabbit_gait_design.library import design_library
    from rabbit_gait_design.plots import save

    own_folder(folder.out, "gait")
    console = Console()
    try:
        folder.out.mkdir(parents=True, exist_ok=True)
        if folder.library:
            cache = Cache(folder.out / "cache")
            wanted = folder.library, folder.speed_slope, folder.library_slopes
            with going_on_from("the gaits that are found"):
                made: Any = design_library(specification, *wanted, cache, folder.who_runs)
        else:
            with console.status("IPOPT begins") as status:
                made = design_gait(specification, lambda *at: status.update(progress_text(*at)))
        save(made, specification, folder.out)
        show(made.gaits if folder.library else [made], console)
    except ValueError as error:
        fail(f"--library: {error}")
    except (GaitDesignError, JobError) as error:
        fail(error, NOT_FOUND)
    except OSError as error:
        fail(f"--out {folder.out}: {error.strerror}")
    for suffix in ("yaml", "png"):
        print(f"written {folder.out / specification.name}.{suffix}")


def progress_text(iteration: int, cost: float, violation: float) -> str:
    """What the screen says while IPOPT works."""
    return f"iteration {iteration}: cost {cost:.4g}, constraints broken by {violation:.1e}"


def show(gaits: Sequence[Any], console: Any) -> None:
    """The figures of one gait, a row each; some of them of several gaits, a row for each gait."""
    from rich.table import Table

    figures = [gait.metadata["figures"] for gait in gaits]
    if len(gaits) == 1:
        table = Table(show_header=False)
        for name, value in figures[0].items():
            table.add_row(name, f"{value:.4g}")
    else:
        table = Table("length", "slope", *(name.replace("_", " ") for name in SHOWN), padding=0)
        for gait, of in zip(gaits, figures, strict=True):
            table.add_row(f"{gait.step_length:g}", f"{gait.slope:g}", *(f"{of[name]:.4g}" for name in SHOWN))
    console.print(table)
