"""Find a gait: periodic, within the limits of robot and ground, both stone barriers kept."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import typer
from pydantic import Field
from rabbit_common.options import Given, fail, options
from rabbit_common.own_folder import own_folder
from rabbit_description.validation import Checked

from rabbit_gait_design.specification import GaitSpecification

NOT_FOUND = 1

app = typer.Typer(add_completion=False)


class FolderOptions(Checked):
    """Options of `rabbit gait` besides those of the specification."""

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
    from rich.console import Console

    from rabbit_gait_design.design import GaitDesignError, design_gait
    from rabbit_gait_design.library import design_library
    from rabbit_gait_design.plots import save

    own_folder(folder.out, "gait")
    console = Console()
    try:
        folder.out.mkdir(parents=True, exist_ok=True)
        with console.status("IPOPT begins") as status:

            def progress(of: str = "") -> Callable[[int, float, float], None]:
                return lambda *at: status.update(of + progress_text(*at))

            if folder.library:
                lengths, slopes = folder.library, folder.library_slopes
                made: Any = design_library(
                    specification, lengths, folder.speed_slope, slopes, lambda name: progress(f"{name}: ")
                )
            else:
                made = design_gait(specification, progress())
            save(made, specification, folder.out)
        show(made.gaits if folder.library else [made], console)
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


def show(gaits: Sequence[Any], console: Any) -> None:
    """A row for each of the figures, a column for each gait."""
    from rich.table import Table

    table = Table("", *(f"{gait.step_length:g} m" + f", {gait.slope:g}°" * bool(gait.slope) for gait in gaits))
    for name in gaits[0].metadata["figures"]:
        table.add_row(name, *(f"{gait.metadata['figures'][name]:.4g}" for gait in gaits))
    console.print(table)
