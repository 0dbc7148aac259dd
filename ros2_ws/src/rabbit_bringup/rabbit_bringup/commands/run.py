"""Run a package's executable, as `ros2 run` does."""

import os

import typer
from rabbit_common.executables import LaunchError, find_executable
from rabbit_common.options import fail

app = typer.Typer(add_completion=False)
SETTINGS = {"ignore_unknown_options": True, "allow_extra_args": True, "allow_interspersed_args": False}


@app.command(context_settings=SETTINGS)
def run(
    context: typer.Context,
    package: str = typer.Argument(help="package, for example rabbit_sim"),
    executable: str = typer.Argument(help="its executable, for example simulator"),
) -> None:
    """Become a package's executable; what follows is handed to it."""
    try:
        path = find_executable(package, executable)
    except LaunchError as error:
        fail(error)
    os.execv(path, [str(path), *context.args])
