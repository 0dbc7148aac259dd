"""Walk with a lab's sensors: errors and consistency of the state estimator."""

import json
from pathlib import Path
from typing import Any

import typer
from pydantic import Field
from rabbit_common.options import Defaults, Given, fail, options
from rabbit_common.own_folder import own_folder
from rabbit_experiments.commands.evaluate import given_assembly
from rabbit_experiments.conditions import EVALUATION_LAG, WalkOptions
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters

DEFAULTS = Defaults(always={"motor_lag": EVALUATION_LAG, "sensors": "lab"})

app = typer.Typer(add_completion=False)


class EstimatorOptions(WalkOptions):
    """Options of `rabbit estimator` besides those of plant and controller."""

    out: Path = Field(Path("runs/estimator"), description="folder for errors.json and errors.png")


@app.command()
@options(EstimatorOptions, ControllerParameters, SimulationParameters, defaults=DEFAULTS)
def estimator(given: Given) -> None:
    """Walk with a lab's sensors: errors and consistency of the state estimator, in DIR/errors.json."""
    request = given.build(EstimatorOptions)
    assembly = given_assembly(given, request.policy, request.parameters)
    if assembly.simulation.sensors == "exact":
        fail("--sensors exact: expected lab, from which there is something to estimate")
    from rabbit_description.atomic_file import replace_text
    from rabbit_experiments import provenance
    from rabbit_experiments.evaluation import episode_seeds
    from rich.progress import track

    from rabbit_estimation.estimation_errors import estimated_walk, summarise

    own_folder(request.out, "estimator")
    seeds = episode_seeds(request.seed, request.runs).values()
    walks = [estimated_walk(assembly, seed) for seed in track(seeds, "walks")]
    summary = summarise(walks)
    about = {"command": provenance.command(), "commit": provenance.commit(), "seed": request.seed}
    replace_text(request.out / "errors.json", json.dumps(summary | about, indent=2))
    draw(walks[0], assembly.simulation.tick_seconds, request.out / "errors.png")
    show(summary)
    print(f"written {request.out}")


def show(summary: dict[str, Any]) -> None:
    """The errors on the screen."""
    from rich.console import Console
    from rich.table import Table

    from rabbit_estimation.estimation_errors import AFTER, UNITS

    outcomes = ", ".join(f"{count} {name}" for name, count in sorted(summary["outcomes"].items()))
    title = f"{summary['walks']} walks, {summary['ticks']} ticks: {outcomes}"
    table = Table("", "rms error", "claimed", "NEES", title=title)
    for name, unit in UNITS.items():
        errors = f"{summary['rms'][name]:.4f}", f"{summary['claimed'][name]:.4f}", f"{summary['nees_of'][name]:.2f}"
        table.add_row(f"{name} ({unit})", *errors)
    low, high = summary["bounds"]
    Console().print(table)
    print(f"NEES {summary['nees']:.2f}, NIS {summary['nis']:.2f}; 1: consistent, above: too sure")
    print(f"NEES in the {AFTER} ticks after a touchdown {summary['nees_after_touchdown']:.2f}")
    print("share of the ticks in which the mean over the walks is within its 95% bounds, and above them:")
    print(f"NEES ({low:.2f} to {high:.2f}) {summary['within']:.0%}, {summary['above']:.0%}")
    print(f"NIS {summary['nis_within']:.0%}, {summary['nis_above']:.0%}")


def draw(walk: Any, tick_seconds: float, path: Path) -> None:
    """One walk's errors inside twice what is claimed."""
    import numpy as np
    from rabbit_viewer import style

    from rabbit_estimation.estimation_errors import NAMES, UNITS

    with style.look():
        figure, panels = style.figure(len(UNITS), height=1.2, width=7.2)
        time = tick_seconds * np.arange(len(walk.errors))
        for axes, (name, unit) in zip(panels, UNITS.items(), strict=True):
            first = NAMES.index(name)
            axes.plot(time, walk.errors[:, first], color=style.BLACK, linewidth=0.8)
            for sign in (-2, 2):
                axes.plot(time, sign * walk.stds[:, first], color=style.ORANGE, linewidth=0.8, linestyle="--")
            axes.set_ylabel(f"{name}\n({unit})")
        panels[-1].set_xlabel("time (s)")
        figure.suptitle("error (black) and twice the claimed standard deviation (dashed); the first of each kind")
        style.save(figure, path)
