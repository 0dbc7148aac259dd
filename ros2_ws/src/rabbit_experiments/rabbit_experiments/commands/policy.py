"""Policy files: show, verify, load."""

import json
import sys
from contextlib import closing
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from rabbit_common.executables import Refused
from rabbit_common.options import check_namespace, complaints, fail

if TYPE_CHECKING:
    from rl_cbf_clf_controller.weights import PolicyFile

NOBODY = 1
PATIENCE = 2.0  # s in which a graph that is there is found
ANSWER_SECONDS = 60.0  # for a controller that is there to answer

app = typer.Typer(help="Policy files: show, verify, load.", no_args_is_help=True, add_completion=False)
File = Annotated[Path, typer.Argument(help="policy file (.safetensors), or the name of a shipped one")]


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
def load(
    file: Annotated[Path, typer.Argument(help="policy file (.safetensors), the name of a shipped one, or zero")],
    namespace: Annotated[str, typer.Option(help="namespace of the graph")] = "",
    timeout: Annotated[
        float | None, typer.Option(help="s to wait for a graph; by default one must be there", min=0.1, max=3600)
    ] = None,
) -> None:
    """Have a running controller put a policy in force; exit code 1 if there is none, 2 if it refuses the file."""
    check_namespace(namespace)
    policy = _known(str(file))
    try:
        from rabbit_common.ros.client import GraphClient
    except ModuleNotFoundError:
        fail("no ROS 2 workspace is sourced: source ros2_ws/install/setup.bash", NOBODY)
    with complaints(Refused), closing(GraphClient("question", namespace)) as client:
        service = client.client("load_policy").service_name
        patience = ANSWER_SECONDS if timeout is None else timeout
        if not client.client("load_policy").wait_for_service(min(PATIENCE, patience)):
            if timeout is None and not client.others():
                where = f"no graph in namespace {client.node.get_namespace()}"
                fail(f"{where}: start one with `rabbit walk`, or wait for one with --timeout", NOBODY)
            if patience > PATIENCE:
                print(f"waiting for {service}, {patience:g} s at most", file=sys.stderr, flush=True)
        answer = client.ask("load_policy", patience, policy=policy)
        if answer is None:
            fail(f"no answer from {service} after {patience:g} s: is the graph running?", NOBODY)
    if not answer.success:
        fail(f"the controller refused {file}: {answer.message}")
    print(f"{file}: loaded, version {answer.version}")


def _known(name: str) -> str:
    """What the controller is asked for; a name that is nothing here ends with a line.

    An absolute path may be one of the controller's machine.
    """
    from rabbit_description.bounded_file import is_file
    from rl_cbf_clf_controller.policy import ZeroPolicy
    from rl_cbf_clf_controller.weights import policy_path, shipped_policies

    path = policy_path(name)
    if name == ZeroPolicy.version:
        return name
    if not (is_file(path) or path.is_absolute()):
        fail(f"{name}: expected a policy file, {ZeroPolicy.version}, or one of {', '.join(shipped_policies())}")
    return str(path.absolute())


def _read(file: Path) -> "PolicyFile":
    from rl_cbf_clf_controller.weights import PolicyFileError, policy_path, read

    with complaints(PolicyFileError):
        return read(policy_path(str(file)))
