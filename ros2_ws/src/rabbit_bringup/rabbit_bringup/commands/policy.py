"""`rabbit policy`: what is in a policy file, and whether it can be trusted."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from rabbit_bringup.commands.options import complaints

if TYPE_CHECKING:
    from rl_cbf_clf_controller.weights import PolicyFile

app = typer.Typer(help="Policy files: show, verify.", no_args_is_help=True, add_completion=False)
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


def _read(file: Path) -> "PolicyFile":
    from rl_cbf_clf_controller.weights import PolicyFileError, read

    from rabbit_bringup.experiments.assembly import shipped_path

    shipped = shipped_path(str(file))
    with complaints(PolicyFileError):
        return read(shipped if shipped.is_file() else file)
