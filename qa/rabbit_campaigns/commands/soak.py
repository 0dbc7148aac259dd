"""Walk for an hour with learning, recording and an operator on: does anything grow or fall?"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import typer
from pydantic import Field
from rabbit_bringup.commands.walk import given_training, make_folder
from rabbit_bringup.launching.walk import MOST_EPISODES, WalkOptions, WalkSettings
from rabbit_common.options import Defaults, Given, complaints, fail, options, tell_if_bare
from rabbit_experiments.commands.evaluate import given_assembly
from rabbit_experiments.conditions import EVALUATION_LAG, TuningOptions
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters

OVER = 1  # exit code where a bar is not kept
READY = 600.0  # s for the nodes to find each other: a soak may begin on a busy machine
TRAINER_TIMEOUT = 3600.0  # s
CAPACITY = 5_000  # transitions kept: a replay buffer that still fills up would look like a leak
SURE = {  # walks every course, with any policy whose estimates are small
    "controller": "rl-cbf-clf-qp",
    "adaptation": "identification",
    "objective": "pd_centred",
    "gait": "paper_stones",
    "stone_margin": 0.01,
    "mass_scale": 2.0,
}
DEFAULTS = Defaults(always={"motor_lag": EVALUATION_LAG}, bare=SURE)
OF_WALK = {"out", "seed", "pace"}

app = typer.Typer(add_completion=False)


class SoakOptions(TuningOptions):
    """The options of `rabbit soak` besides plant and controller."""

    out: Path | None = Field(
        None, description="folder for recording, samples and figures (default: runs/DATE-seed-SEED)"
    )
    minutes: float = Field(60.0, gt=0, le=10_000, description="length by the wall clock, minutes")
    operate_every: float = Field(
        15.0, ge=0, le=3600, description="time between operations beside the walk, s; 0: no operations"
    )
    pace: float | None = Field(None, ge=0, le=100, description="times real time, at most; 0: no limit (default: 0)")
    seed: int = Field(1, ge=0, le=2**63 - 1, description="seed of the first episode and of the operations")


@app.command()
@options(SoakOptions, ControllerParameters, SimulationParameters, defaults=DEFAULTS)
def soak(given: Given, context: typer.Context) -> None:
    """Walk for an hour with learning, swapping, recording and an operator on; exit code 1 if a bar is not kept."""
    asked = given.build(SoakOptions)
    tell_if_bare(
        context, f"A walk of {asked.minutes:g} minutes by the wall clock. To begin:", "rabbit soak --minutes 60"
    )
    assembly = given_assembly(given, "zero", asked.parameters, oracle=False)
    if not assembly.controller.learns:
        fail(f"--controller {assembly.controller.controller}: expected one that learns; its policies are swapped")
    from rabbit_campaigns.soak_operations import idle_policy

    options = WalkOptions(**asked.model_dump(include=OF_WALK), episodes=MOST_EPISODES, ready_timeout=READY)
    folder = make_folder(options)
    idle_policy(assembly.controller).write(folder / "policy.safetensors")
    assembly = replace(assembly, policy=str(folder / "policy.safetensors"))
    training = given_training(options, assembly.controller, assembly.policy) | {"capacity": CAPACITY}
    further = {"simulator": {"trainer_timeout": TRAINER_TIMEOUT}}
    walk = WalkSettings.of(assembly, folder, options, training=training, further=further)
    from rabbit_recording import RecordingError

    from rabbit_campaigns.figures import under_way, write_figures
    from rabbit_campaigns.soak import SAMPLES, judge, read_samples
    from rabbit_campaigns.soak import soak as walk_on
    from rabbit_campaigns.soak_operations import judge_operations

    with under_way(folder, ValueError) as show_status:
        walk_on(walk, asked.minutes * 60, show_status, asked.operate_every)
    with complaints(RecordingError):
        of_walk, bars = judge_operations(folder)
    figures = {**judge(read_samples(folder / SAMPLES)), **of_walk}
    figures["bars_kept"] |= bars
    write_figures(folder / "soak.json", figures)
    show(figures)
    print(f"written to {folder}")
    if not all(figures["bars_kept"].values()):
        raise typer.Exit(OVER)


def show(figures: dict[str, Any]) -> None:
    """The figures on the screen."""
    for name, node in figures["nodes"].items():
        parts = ("memory_mb", "descriptors", "threads")
        pairs = ("{} {:.0f} to {:.0f}".format(what.replace("_mb", " (MB)"), *node[what]) for what in parts)
        print(f"{name}: {', '.join(pairs)}; memory grew by {node['growth']:.1%}")
    first, last = figures["ticks_per_second"]
    drift, low, high = figures["cpu_drift"]
    print(f"{figures['ticks']} ticks, {figures['episodes']} episodes; load {figures['load'][1]:.1f}")
    print(
        f"{first:.1f} to {last:.1f} ticks/s; simulator and controller {figures['cpu_ms_per_tick']:.2f} ms of processor"
    )
    print(f"time a tick, drift over the whole {drift:+.1%} ({low:+.1%} to {high:+.1%})")
    print(f"policies in force: {figures['policies_put_in_force']}; ticks not recorded: {figures['ticks_not_recorded']}")
    walks = figures["walks"]
    print(f"{walks['walked']} of {walks['ended']} episodes walked, {walks['reset']} were reset by the operator")
    for fall in walks["fell"]:
        print("  episode {}, seed {}: {} {}".format(*fall))
    if operations := figures["operations"]:
        print("as expected: " + ", ".join(f"{kind} {right} of {asked}" for kind, (asked, right) in operations.items()))
    for bar, kept in figures["bars_kept"].items():
        print(f"{bar}: {'kept' if kept else 'NOT KEPT'}")
