"""Time a tick, the plant and an evaluation, each against its floor."""

from datetime import datetime
from pathlib import Path
from typing import Any

import typer
from pydantic import Field
from rabbit_bringup.commands.walk import DEFAULTS
from rabbit_common.options import Given, fail, options
from rabbit_common.own_folder import new_file
from rabbit_experiments.commands.evaluate import given_assembly
from rabbit_experiments.conditions import TuningOptions
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters

app = typer.Typer(add_completion=False)


class BenchOptions(TuningOptions):
    """The options of `rabbit bench` besides plant and controller."""

    out: Path | None = Field(None, description="file for the figures (default: runs/DATE-bench.json)")
    seed: int = Field(9001, ge=0, le=2**32 - 1, description="seed of course and first state")
    policy: str | None = Field(None, description="zero, oracle, a shipped policy or a file")
    batch: int = Field(
        0, ge=0, le=4096, description="robots that walk at once in MuJoCo, timed against the bare engine; 0: none"
    )
    ticks: int = Field(100_000, ge=1, description="ticks of all robots together (needs --batch)")


@app.command()
@options(BenchOptions, ControllerParameters, SimulationParameters, defaults=DEFAULTS)
def bench(given: Given) -> None:
    """Time ticks, walks and a batch of the usual controllers, each beside its floor in the same run.

    With `--batch N`: N robots of these options at once in MuJoCo against `mujoco.rollout` alone, and evaluation in a
    batch against one run at a time.
    """
    request = given.build(BenchOptions)
    out = new_file(request.out or Path("runs") / f"{datetime.now():%Y%m%d-%H%M%S}-bench.json")
    assembly = given_assembly(given, request.policy, request.parameters)
    from rabbit_campaigns import bench
    from rabbit_campaigns.figures import print_table, write_figures

    if request.batch and assembly.simulation.plant != "mujoco":
        fail(f"--batch {request.batch} with --plant {assembly.simulation.plant}: expected --plant mujoco")
    if request.batch:
        from rabbit_campaigns.batch_bench import bench_batch

        figures = bench_batch(assembly, request.batch, request.ticks, request.seed)
        show_batch(figures)
    else:
        figures = bench.bench(request.seed)
        print_table(("figure", ""), [(name, f"{value:.3g}") for name, value in figures.items()])
    write_figures(out, figures)
    print(f"written to {out}")


def show_batch(figures: dict[str, Any]) -> None:
    """Times, memory and ratios."""
    from rabbit_campaigns.figures import print_table

    rows = {f"{name}, us of CPU a robot and tick": f"{us:.1f}" for name, us in figures["us"].items()}
    rows |= {f"memory {name}, MB": f"{mb:.1f}" for name, mb in figures["memory_mb"].items()}
    rows |= {name: f"{ratio:.2f}" for name, ratio in figures["ratios"].items()}
    print_table(("", ""), rows.items(), f"{figures['robots']} robots, {figures['robot_ticks']} ticks of a robot")
