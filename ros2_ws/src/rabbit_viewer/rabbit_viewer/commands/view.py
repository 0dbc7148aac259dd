"""A running graph in the browser, and in RViz."""

import json
import os

import typer
from pydantic import Field
from rabbit_common.executables import NAMESPACE, LaunchError, find_executable
from rabbit_common.options import Given, complaints, options

from rabbit_viewer.live.parameters import ViewerParameters

app = typer.Typer(add_completion=False)


class ViewOptions(ViewerParameters):
    """The options of `rabbit view`."""

    browser: bool = Field(True, description="open the page in a browser")
    namespace: str = Field("", pattern=NAMESPACE, description="namespace of the graph")


@app.command()
@options(ViewOptions)
def view(given: Given) -> None:
    """Show a running graph in the browser: robot, stones, barriers, force and plots; the same as topics for RViz."""
    chosen = given.build(ViewOptions)
    with complaints(LaunchError):
        path = find_executable("rabbit_viewer", "viewer")
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    parameters = chosen.model_dump(include=set(ViewerParameters.model_fields))
    words = [word for name, value in parameters.items() for word in ("-p", f"{name}:={json.dumps(value)}")]
    enclave = "/rabbit/viewer_control" if chosen.control else "/rabbit/viewer"
    remaps = ("-r", f"__ns:=/{chosen.namespace.strip('/')}", "--enclave", enclave, "--log-level", "warn")
    os.execv(path, [str(path), "--ros-args", *words, *remaps])
