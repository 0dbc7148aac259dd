"""`rabbit policy`: what is in a policy file, whether it can be trusted, and handing it to a running controller."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rabbit_bringup.commands.options import complaints, fail
from rabbit_bringup.launching.executables import LaunchError

if TYPE_CHECKING:
    from rl_cbf_clf_controller.weights import PolicyFile

NOBODY = 1

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
    print(f"{file}: sound; {policy.metadata.problem}, version {policy.version}")


@app.command()
def load(
    file: File,
    namespace: Annotated[str, typer.Option(help="of the graph")] = "",
    timeout: Annotated[float, typer.Option(help="s to wait for the controller", min=0.1, max=3600)] = 5.0,
) -> None:
    """Have a running controller put a policy in force; exit code 1 if there is none, 2 if it refuses the file."""
    from rabbit_bringup.launching.walk import WalkOptions

    with complaints():
        WalkOptions(namespace=namespace)
    try:
        from rabbit_bringup.launching.ask_node import load_policy

        answer = load_policy(_path(file), namespace, timeout)
    except ModuleNotFoundError:
        fail("no ROS 2 workspace is sourced: source ros2_ws/install/setup.bash", NOBODY)
    except LaunchError as error:
        fail(error, NOBODY)
    if not answer.accepted:
        fail(f"the controller refused {file}: {answer.message}")
    print(f"{file}: loaded, version {answer.version}")


def _path(file: Path) -> Path:
    """The file, or the shipped policy of this name."""
    from rabbit_bringup.experiments.assembly import shipped_path

    shipped = shipped_path(str(file))
    return shipped if shipped.is_file() else file


def _read(file: Path) -> "PolicyFile":
    from rl_cbf_clf_controller.weights import PolicyFileError, read

    with complaints(PolicyFileError):
        return read(_path(file))
