"""`rabbit soak`: a long walk through all nodes; what it takes of the machine, sampled, drawn and judged."""

from pathlib import Path
from typing import Any

import typer
from pydantic import BaseModel, ConfigDict, Field
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters

from rabbit_bringup.commands.evaluate import given_assembly
from rabbit_bringup.commands.options import Given, complaints, fail, options
from rabbit_bringup.commands.walk import DEFAULTS, given_training, make_folder
from rabbit_bringup.experiments.timed_walk import EPISODES
from rabbit_bringup.launching.walk import Interrupted, WalkOptions, make_graph

OVER = 1  # exit code where a bar is not kept
READY = 600.0  # s for the nodes to find each other: a soak may begin on a busy machine
TRAINER_TIMEOUT = 3600.0  # s

app = typer.Typer(add_completion=False)


class SoakOptions(BaseModel):
    """What `rabbit soak` is told besides plant and controller."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    out: Path | None = Field(None, description="folder for recording, samples, figures (default: runs/DATE-seed-SEED)")
    minutes: float = Field(60.0, gt=0, le=10_000, description="of the wall clock")
    every: float = Field(5.0, ge=0.5, le=600, description="s between samples")
    seed: int = Field(1, ge=0, le=2**63 - 1, description="of the first episode")
    policy: str | None = Field(None, description="to begin with: zero, a shipped policy or a file")
    training: Path | None = Field(None, description="YAML file of training parameters")
    parameters: str = Field("ours", description="of the controller: ours, authors or a YAML file")


@app.command()
@options(SoakOptions, ControllerParameters, SimulationParameters)
def soak(given: Given) -> None:
    """Walk for an hour with learning, swapping and recording on; exit code 1 if memory or descriptors grow."""
    if not given.values.keys() & {"controller", "parameters"}:
        given = Given({**DEFAULTS, **given.values})
    told = given.build(SoakOptions)
    assembly = given_assembly(given, told.policy, told.parameters)
    if assembly.policy == "oracle":
        fail("--policy oracle: expected zero, a shipped policy or a file; the nodes never see the true plant")
    own = told.model_dump(include={"out", "seed", "policy", "training"})
    request = WalkOptions(**own, episodes=EPISODES, ready_timeout=READY)
    folder = make_folder(request)
    training = given_training(request, assembly.controller, assembly.policy)
    graph = make_graph(folder, request, assembly.simulation, assembly.controller, assembly.policy, training)
    graph.parameters["simulator"]["trainer_timeout"] = TRAINER_TIMEOUT
    from rich.console import Console

    from rabbit_bringup.experiments import soak as experiment
    from rabbit_bringup.launching.executables import LaunchError
    from rabbit_bringup.recording.bag_writer import RecordingError

    with complaints(LaunchError), Console().status("starting") as status:
        try:
            experiment.soak(graph, request, told.minutes * 60, told.every, status.update)
        except Interrupted as error:
            fail(f"stopped by {error}; what was sampled is in {folder}", code=error.code)
    with complaints(RecordingError):
        figures = judged(folder)
    show(figures)
    print(f"written to {folder}")
    if not all(figures["bars_kept"].values()):
        raise typer.Exit(OVER)


def judged(folder: Path) -> dict[str, Any]:
    """The figures and the picture of a soak, from what it left."""
    from rabbit_bringup.experiments.soak import SAMPLES, read_samples, write_figures
    from rabbit_bringup.experiments.soak_picture import draw_soak
    from rabbit_bringup.recording.reader import iterate_episodes

    swaps = lost = 0
    for episode in iterate_episodes(folder / "recording"):
        swaps += sum(swap.tick > 0 for swap in episode.swaps)
        lost += episode.missing if episode.outcome else 0  # the last one is cut off
    draw_soak(read_samples(folder / SAMPLES), folder / "soak.png")
    return write_figures(folder, swaps, lost)


def show(figures: dict[str, Any]) -> None:
    """A table on the screen."""
    from rich.console import Console
    from rich.table import Table

    table = Table("node", "memory (MB)", "growth", "descriptors", "threads")
    for name, node in figures["nodes"].items():
        pairs = [" to ".join(f"{value:.{digits}f}" for value in node[what]) for what, digits in COLUMNS]
        table.add_row(name, pairs[0], f"{node['growth']:+.1%}", *pairs[1:])
    Console().print(table)
    first, last = figures["ticks_per_second"]
    drift, low, high = figures["cpu_drift"]
    print(f"{figures['ticks']} ticks, {figures['episodes']} episodes; load {figures['load'][1]:.1f}")
    print(
        f"{first:.1f} to {last:.1f} ticks/s; simulator and controller {figures['cpu_ms_per_tick']:.2f} ms of processor"
    )
    print(f"time a tick, drift over the whole {drift:+.1%} ({low:+.1%} to {high:+.1%})")
    print(
        f"{figures['policies_put_in_force']} policies put in force, {figures['ticks_not_recorded']} ticks not recorded"
    )
    for bar, kept in figures["bars_kept"].items():
        print(f"{bar}: {'kept' if kept else 'NOT KEPT'}")


COLUMNS = (("memory_mb", 1), ("descriptors", 0), ("threads", 0))
