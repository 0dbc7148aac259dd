"""What `rabbit gait` runs: specification in, a folder with the file of the gait or library and its picture out."""

from collections.abc import Callable, Sequence
from pathlib import Path

from rabbit_description.gait import Gait, GaitLibrary
from rabbit_viewer import style

from rabbit_gait_design.design import Progress, design_gait
from rabbit_gait_design.library import design_library
from rabbit_gait_design.orbit import Stone
from rabbit_gait_design.plots import plot_gait, plot_library
from rabbit_gait_design.specification import GaitSpecification


def run(specification: GaitSpecification, out: Path, progress: Progress | None = None) -> Gait:
    """Design a gait and write `NAME.yaml` and `NAME.png`.

    Raises:
        GaitDesignError: IPOPT did not converge.
        OSError: the folder cannot be written.
    """
    out.mkdir(parents=True, exist_ok=True)
    gait = design_gait(specification, progress)
    gait.save(out / f"{gait.name}.yaml")
    with style.look():
        style.save(plot_gait(gait, designed_stone(specification)), out / f"{gait.name}.png", dpi=110)
    return gait


def run_library(
    base: GaitSpecification,
    lengths: Sequence[float],
    out: Path,
    speed_slope: float = 0.0,
    slopes: Sequence[float] = (),
    progress: Callable[[str], Progress] | None = None,
) -> GaitLibrary:
    """Design a library around `base`, whose step length and slope it starts with; write `NAME.yaml` and `NAME.png`.

    Raises:
        ValueError: lengths or slopes that make no library.
        GaitDesignError: IPOPT did not converge at one of them.
        OSError: the folder cannot be written.
    """
    out.mkdir(parents=True, exist_ok=True)
    library = design_library(base, lengths, base.step_length, speed_slope, slopes, progress)
    library.save(out / f"{library.name}.yaml")
    with style.look():
        style.save(plot_library(library), out / f"{library.name}.png", dpi=110)
    return library


def designed_stone(specification: GaitSpecification) -> Stone | None:
    """The stone whose barriers the gait keeps; None without barriers."""
    if not specification.barriers:
        return None
    near, far = specification.step_length - specification.near_edge, specification.step_length + specification.far_edge
    return Stone(near, far, specification.R1, specification.R2, specification.barrier_poles)
