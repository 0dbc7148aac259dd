"""What `rabbit gait` runs: specification in, a folder with the gait file, its pictures and its payload table out."""

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path

from matplotlib.figure import Figure
from rabbit_description.atomic_file import replace_text, replacing
from rabbit_description.gait import Gait, GaitLibrary

from rabbit_gait_design.analysis import PAYLOADS, PayloadReport, over_payloads
from rabbit_gait_design.design import Progress, design_gait
from rabbit_gait_design.library import design_library
from rabbit_gait_design.orbit import Stone
from rabbit_gait_design.plots import plot_gait, plot_library, plot_payloads
from rabbit_gait_design.specification import GaitSpecification


def run(
    specification: GaitSpecification,
    out: Path,
    progress: Progress | None = None,
    payloads: Sequence[float] = PAYLOADS,
) -> tuple[Gait, list[PayloadReport]]:
    """Design a gait and write `NAME.yaml`, `NAME.png` and, for `payloads` in kg, `NAME_payload.json` and `.png`.

    Raises:
        GaitDesignError: IPOPT did not converge.
        OSError: the folder cannot be written.
    """
    out.mkdir(parents=True, exist_ok=True)
    gait = design_gait(specification, progress)
    gait.save(out / f"{gait.name}.yaml")
    _write(plot_gait(gait, designed_stone(specification)), out / f"{gait.name}.png")
    reports = over_payloads(gait, payloads)
    if reports:
        table = json.dumps([asdict(report) for report in reports], indent=1)
        replace_text(out / f"{gait.name}_payload.json", table)
        _write(plot_payloads({gait.name: reports}), out / f"{gait.name}_payload.png")
    return gait, reports


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
    _write(plot_library(library), out / f"{library.name}.png")
    return library


def designed_stone(specification: GaitSpecification) -> Stone | None:
    """The stone whose barriers the gait keeps; None without barriers."""
    if not specification.barriers:
        return None
    return Stone(
        l_min=specification.step_length - specification.near_edge,
        l_max=specification.step_length + specification.far_edge,
        R1=specification.R1,
        R2=specification.R2,
        poles=specification.barrier_poles,
    )


def _write(figure: Figure, path: Path) -> None:
    with replacing(path) as partial:
        figure.savefig(partial, dpi=110)
