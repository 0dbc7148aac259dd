"""Time a tick, its parts and a walk against their limits."""

import json
from pathlib import Path
from typing import Any

import typer
from pydantic import BaseModel, ConfigDict, Field
from rabbit_cli.options import Given, complaints, options
from rabbit_experiments.commands.evaluate import DEFAULTS, given_assembly
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters

app = typer.Typer(add_completion=False)


class BenchOptions(BaseModel):
    """The options of `rabbit bench` besides plant and controller."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    out: Path = Field(Path("runs/bench.json"), description="file for the figures")
    seed: int = Field(9001, ge=0, le=2**32 - 1, description="of the walk")
    policy: str | None = Field(None, description="zero, oracle, a shipped policy or a file")
    parameters: str = Field("ours", description="of the controller: ours, authors or a YAML file")
    nodes: bool = Field(True, description="also walk through the nodes, where there is ROS")


@app.command()
@options(BenchOptions, ControllerParameters, SimulationParameters, defaults=DEFAULTS)
def bench(given: Given) -> None:
    """Time a tick, its parts, both QP solvers, the plant and a whole walk, in one process and through the nodes."""
    request = given.build(BenchOptions)
    assembly = given_assembly(given, request.policy, request.parameters)
    from rabbit_cli.executables import LaunchError
    from rabbit_experiments import provenance

    from rabbit_campaigns.bench import bench as measure
    from rabbit_campaigns.bench import bench_nodes

    with complaints(LaunchError):
        figures = measure(assembly, request.seed)
        figures["nodes"] = bench_nodes(assembly, request.seed) if request.nodes else None
    about = {"command": provenance.command(), "commit": provenance.commit(), "versions": provenance.versions()}
    show(figures)
    request.out.parent.mkdir(parents=True, exist_ok=True)
    request.out.write_text(json.dumps({**figures, **about}, indent=2), encoding="utf-8")
    print(f"written to {request.out}")


def show(figures: dict[str, Any]) -> None:
    """Tables on the screen."""
    from rich.console import Console
    from rich.table import Table

    table = Table("ms", "median", "p99", "CPU median", "CPU p99", title=f"{figures['ticks']} ticks")
    whole = {name: value for name, value in figures.items() if isinstance(value, dict) and "wall_ms_p50" in value}
    parts = {f"  {part}": times for part, times in figures["parts"].items()}
    for name, times in {**whole, **parts, **figures["solvers"]}.items():
        table.add_row(
            name, *(f"{times[key]:.3f}" for key in ("wall_ms_p50", "wall_ms_p99", "cpu_ms_p50", "cpu_ms_p99"))
        )
    console = Console()
    console.print(table)
    print(
        f"walk: {figures['real_time_factor']:.1f} times real time (by CPU time {figures['real_time_factor_cpu']:.1f})"
    )
    for name, ratio in figures["ratios"].items():
        print(f"{name}: {ratio:.2f}")
    if figures["nodes"]:
        nodes = figures["nodes"]
        print(f"through the nodes: {nodes['real_time_factor']:.1f} times real time, / limit: {nodes['ratio']:.2f}")
