"""How well gaits walk: stones in process, and what a known payload leaves of the walk. For docs/gaits.md.

python -m rabbit_experiments.gait_report stones_0350_080 authors_035 --runs 50 --out runs/gait_report
"""

import json
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import typer
from rabbit_description.gait import GaitError, load_gait, shipped_gaits
from rabbit_gait_design.analysis import PayloadReport, over_payloads
from rabbit_gait_design.plots import plot_payloads
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import load_parameters

from rabbit_experiments.assembly import Assembly
from rabbit_experiments.conditions import EVALUATION_LAG
from rabbit_experiments.evaluation import episode_seeds, evaluate
from rabbit_experiments.markdown import markdown_table
from rabbit_experiments.summary import summarise

CASES: tuple[tuple[float, str], ...] = ((1.0, "zero"), (2.0, "zero"), (2.0, "oracle"))  # mass scale, policy


@dataclass(frozen=True)
class WalkReport:
    """Courses walked by one gait in one case; `worst_margin`: of a landing from the nearer edge, m."""

    mass_scale: float
    policy: str
    runs: int
    walked: int
    interval: tuple[float, float]
    mean_stones: float
    worst_margin: float | None
    missed_stones: int
    max_force_ratio: float


@dataclass(frozen=True)
class GaitReport:
    """One gait: its walks over stones and its fixed points under payload."""

    gait: str
    walks: tuple[WalkReport, ...]
    payloads: tuple[PayloadReport, ...]


def walk_report(gait: str, mass_scale: float, policy: str, runs: int, seed: int, jobs: int) -> WalkReport:
    """Walk `runs` courses of 20 stones with the default controller.

    Raises:
        GaitError: no such gait.
    """
    simulation = SimulationParameters(mass_scale=mass_scale, motor_lag=EVALUATION_LAG)
    assembly = Assembly(simulation, load_parameters("ours", gait=gait), policy)
    results = list(evaluate(assembly, episode_seeds(seed, runs), jobs))
    summary = summarise(results, assembly.controller.qp_solver)
    return WalkReport(
        mass_scale=mass_scale,
        policy=policy,
        runs=runs,
        walked=sum(result.row.success for result in results),
        interval=summary["success_rate_ci95"],
        mean_stones=summary["mean_stones"],
        worst_margin=summary["worst_margin"],
        missed_stones=summary["missed_stones"],
        max_force_ratio=summary["max_force_ratio"],
    )


def reports(
    gaits: Sequence[str], runs: int, seed: int, jobs: int, tell: Callable[[str], None] = print
) -> Iterator[GaitReport]:
    """One report a gait, as it is done."""
    for name in gaits:
        walks = []
        for mass_scale, policy in CASES:
            walk = walk_report(name, mass_scale, policy, runs, seed, jobs)
            tell(f"{name}: scale {mass_scale:g}, {policy}: {walk.walked} of {walk.runs} courses")
            walks.append(walk)
        yield GaitReport(name, tuple(walks), tuple(over_payloads(load_gait(name))))


def markdown(rows: Sequence[GaitReport]) -> str:
    """Both tables, as docs/gaits.md and docs/data/gaits.md have them."""
    cases = [f"scale {scale:g}, {policy}" for scale, policy in CASES]
    walks = [
        (f"`{row.gait}`", *(f"{walk.walked} of {walk.runs}, {walk.mean_stones:.1f} stones" for walk in row.walks))
        for row in rows
    ]
    heads = (
        "gait",
        "payload, kg",
        "phase rate",
        "least",
        "eigenvalue",
        "step time, s",
        "peak torque",
        "friction",
        "F_N",
    )
    payloads = [(f"`{row.gait}`", *_payload_cells(load)) for row in rows for load in row.payloads]
    return markdown_table(("gait", *cases), walks) + "\n" + markdown_table(heads, payloads)


def _payload_cells(load: PayloadReport) -> list[str]:
    figures = (load.phase_rate, load.least_phase_rate, load.eigenvalue, load.step_time)
    forces = (f"{load.peak_torque:.0f}", f"{load.friction_used:.2f}", f"{load.least_normal_force:.0f}")
    cells = [f"{figure:.3f}" for figure in figures] + list(forces)
    return [f"{load.payload:g}", *("none" if cell == "nan" else cell for cell in cells)]


def write(rows: Sequence[GaitReport], out: Path) -> None:
    """`gaits.json`, `gaits.md` and `gaits_payload.png` in `out`."""
    out.mkdir(parents=True, exist_ok=True)
    (out / "gaits.json").write_text(json.dumps([_plain(asdict(row)) for row in rows], indent=1), encoding="utf-8")
    (out / "gaits.md").write_text(markdown(rows), encoding="utf-8")
    plot_payloads({row.gait: row.payloads for row in rows}).savefig(out / "gaits_payload.png", dpi=130)


def _plain(value: object) -> object:
    """The same with None for nan, which JSON does not know."""
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    return None if isinstance(value, float) and math.isnan(value) else value


def main(
    gaits: Annotated[list[str] | None, typer.Argument(help="gaits by name or file; all shipped ones")] = None,
    out: Annotated[Path, typer.Option(help="folder for gaits.json, gaits.md, gaits_payload.png")] = Path(
        "runs/gait_report"
    ),
    runs: Annotated[int, typer.Option(min=1, help="courses of 20 stones in each case")] = 50,
    seed: Annotated[int, typer.Option(min=0, help="of courses and first states")] = 9001,
    jobs: Annotated[int, typer.Option(min=1, help="processes")] = 1,
) -> None:
    """Walk every gait over stones and find its fixed points under payload."""
    names = gaits or shipped_gaits()
    try:
        for name in names:
            load_gait(name)
    except GaitError as error:
        typer.echo(error, err=True)
        raise typer.Exit(2) from error
    rows: list[GaitReport] = []
    for row in reports(names, runs, seed, jobs):
        rows.append(row)
        write(rows, out)
    print(f"written {out}")


if __name__ == "__main__":
    typer.run(main)
