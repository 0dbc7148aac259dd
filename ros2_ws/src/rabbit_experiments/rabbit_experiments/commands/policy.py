"""Policy files: show, verify, errors of the estimates, load."""

import json
import sys
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from pydantic import BaseModel, ConfigDict, Field
from rabbit_common.executables import Refused
from rabbit_common.options import Defaults, Given, check_namespace, complaints, fail, options
from rabbit_common.own_folder import new_file
from rabbit_sim.parameters import SimulationParameters
from rl_cbf_clf_controller.parameters import ControllerParameters

from rabbit_experiments.commands.evaluate import describe, given_assembly
from rabbit_experiments.conditions import EVALUATION_LAG, TRAINING_SCALE

if TYPE_CHECKING:
    from rl_cbf_clf_controller.weights import PolicyFile

NOBODY = 1
PATIENCE = 1.0  # s after which it says that it waits
DEFAULTS = Defaults(always={"mass_scale": TRAINING_SCALE, "motor_lag": EVALUATION_LAG})

app = typer.Typer(help="Policy files: show, verify, errors, load.", no_args_is_help=True, add_completion=False)
File = Annotated[Path, typer.Argument(help="policy file (.safetensors), or the name of a shipped one")]


class ErrorsOptions(BaseModel):
    """Options of `rabbit policy errors` besides those of plant and controller."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    runs: int = Field(5, ge=1, le=10_000, description="walks of the policy, and as many of the oracle")
    seed: int = Field(9001, ge=0, le=2**63 - 1, description="of courses, first states and sensor noise")
    parameters: str = Field("ours", description="of the controller: ours, best, authors or a YAML file")
    out: Path | None = Field(None, description="file for the figures, JSON")


@app.command()
def show(file: File) -> None:
    """Print a policy file's metadata, version and arrays."""
    policy = _read(file)
    print(json.dumps(policy.metadata.model_dump(mode="json"), indent=2))
    print(f"version {policy.version}, content hash {policy.content_hash}")
    for name, array in policy.arrays.items():
        print(f"{name:>14} {array.dtype} {array.shape}")


@app.command()
def verify(file: File) -> None:
    """Check layout, names, shapes, finite values, hash and probe; exit code 2 where something is wrong."""
    policy = _read(file)
    print(f"{file}: sound; {policy.metadata.about}, version {policy.version}")


@app.command()
@options(ErrorsOptions, ControllerParameters, SimulationParameters, without=("controller",), defaults=DEFAULTS)
def errors(given: Given, file: File) -> None:
    """Errors of a policy's estimates against the oracle's, on walks of both (by default at twice the mass)."""
    request = given.build(ErrorsOptions)
    if request.out:
        new_file(request.out)
    given = given.over({"controller": _read(file).metadata.problem})
    assembly = given_assembly(given, str(file), request.parameters)
    from rabbit_description.atomic_file import replace_text
    from rich.progress import track

    from rabbit_experiments.evaluation import episode_seeds
    from rabbit_experiments.policy_errors import NoTicksError, compare

    seeds = episode_seeds(request.seed, request.runs).values()
    with complaints(NoTicksError):
        found = {who: compare(assembly, who, track(seeds, f"walks of the {who}")) for who in ("policy", "oracle")}
    for walker, figures in found.items():
        show_errors(walker, figures)
    if request.out:
        text = json.dumps({"on_walks_of": found, **describe(assembly, request.seed)}, indent=2)
        request.out.parent.mkdir(parents=True, exist_ok=True)
        replace_text(request.out, text)
        print(f"written to {request.out}")


def show_errors(walker: str, figures: dict[str, Any]) -> None:
    """A table on the screen."""
    from rich.console import Console
    from rich.table import Table

    names = list(next(iter(figures["quantities"].values())))
    walked = sum(walk["outcome"] == "walked" for walk in figures["walks"])
    title = f"walks of the {walker}: {walked} of {len(figures['walks'])} to the end, {figures['ticks']} ticks"
    active = ", ".join(f"{row} {share:.1%}" for row, share in figures["active_share"].items())
    table = Table("", *names, title=title, caption=f"active: {active}")
    for quantity, errors in figures["quantities"].items():
        table.add_row(quantity, *("-" if value is None else f"{value:.4g}" for value in errors.values()))
    Console().print(table)


@app.command()
def load(
    file: File,
    namespace: Annotated[str, typer.Option(help="of the graph")] = "",
    timeout: Annotated[float, typer.Option(help="s to wait for the controller", min=0.1, max=3600)] = 60.0,
) -> None:
    """Have a running controller put a policy in force; exit code 1 if there is none, 2 if it refuses the file."""
    from rl_cbf_clf_controller.weights import policy_path

    check_namespace(namespace)
    try:
        from rabbit_common.ros.client import GraphClient
    except ModuleNotFoundError:
        fail("no ROS 2 workspace is sourced: source ros2_ws/install/setup.bash", NOBODY)
    with complaints(Refused), closing(GraphClient("question", namespace)) as client:
        service = client.client("load_policy").service_name
        if timeout > PATIENCE and not client.client("load_policy").wait_for_service(PATIENCE):
            print(f"waiting for {service}, {timeout:g} s at most", file=sys.stderr, flush=True)
        answer = client.ask("load_policy", timeout, policy=str(policy_path(str(file)).absolute()))
        if answer is None:
            fail(f"no answer from {service} after {timeout:g} s: is the graph running?", NOBODY)
    if not answer.success:
        fail(f"the controller refused {file}: {answer.message}")
    print(f"{file}: loaded, version {answer.version}")


def _read(file: Path) -> "PolicyFile":
    from rl_cbf_clf_controller.weights import PolicyFileError, policy_path, read

    with complaints(PolicyFileError):
        return read(policy_path(str(file)))
