"""Live view of a running graph, in the browser by Foxglove or in RViz."""

import json
import os
from importlib.resources import files
from pathlib import Path

import typer
from pydantic import Field
from rabbit_cli.executables import NAMESPACE, LaunchError, find_executable
from rabbit_cli.options import Given, complaints, fail, options

from rabbit_viewer.live.parameters import ViewerParameters

app = typer.Typer(add_completion=False)


class ViewOptions(ViewerParameters):
    """Of `rabbit view`."""

    namespace: str = Field("", pattern=NAMESPACE, description="of the graph")
    layout: Path | None = Field(None, description="write the layout for Foxglove to this file, and end")


@app.command()
@options(ViewOptions)
def view(given: Given) -> None:
    """Serve a live view of a running graph: robot, stones, barriers, force and plots, to Foxglove and to RViz."""
    chosen = given.build(ViewOptions)
    if chosen.layout is not None:
        write_layout(chosen.layout)
    else:
        become_viewer(chosen)


def write_layout(path: Path) -> None:
    """Copy the layout that is shipped."""
    shipped = files("rabbit_viewer.live") / "layout.json"
    try:
        path.write_text(shipped.read_text(encoding="utf-8"), encoding="utf-8")
    except OSError as error:
        fail(f"--layout {path}: {error.strerror}")
    print(path)


def become_viewer(chosen: ViewOptions) -> None:
    """Hand this process over to the node."""
    with complaints(LaunchError):
        path = find_executable("rabbit_viewer", "viewer")
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    own = chosen.model_dump(include=set(ViewerParameters.model_fields))
    words = [word for name, value in own.items() for word in ("-p", f"{name}:={json.dumps(value)}")]
    remaps = ("-r", f"__ns:=/{chosen.namespace.strip('/')}", "--enclave", "/rabbit/viewer", "--log-level", "warn")
    os.execv(path, [str(path), "--ros-args", *words, *remaps])
