"""`rabbit reproduce`: the paper's figures and claims from this code, its gaits and its policies."""

import os
from pathlib import Path
from typing import Annotated, Literal

import typer

from rabbit_bringup.commands.options import complaints, fail

app = typer.Typer(add_completion=False)


@app.command()
def reproduce(
    names: Annotated[list[str] | None, typer.Argument(help="experiments, by name; all of them")] = None,
    quick: Annotated[bool, typer.Option("--quick", help="few runs of everything")] = False,
    out: Annotated[Path, typer.Option(help="folder; one that was stopped there goes on")] = Path("runs/reproduce"),
    jobs: Annotated[int | None, typer.Option(min=1, max=4096, help="processes (default: all cores)")] = None,
    backend: Annotated[Literal["loky", "ray"], typer.Option(help="processes here, or a Ray cluster's")] = "loky",
    show: Annotated[bool, typer.Option("--list", help="the experiments, and nothing more")] = False,
) -> None:
    """Make the paper's figures and tables anew: DIR/results.md has its figures beside ours, with verdicts."""
    from rabbit_bringup.reproduce.catalogue import EXPERIMENTS
    from rabbit_bringup.reproduce.lines import FULL, QUICK
    from rabbit_bringup.reproduce.making import make
    from rabbit_bringup.reproduce.runner import BackendError

    known = {each.name: each for each in EXPERIMENTS}
    if show:
        for name, each in known.items():
            print(f"{name:20s} {each.title} ({each.label})")
        return
    if wrong := [name for name in names or () if name not in known]:
        fail(f"{wrong[0]}: expected some of {', '.join(known)}")
    chosen = [each for name, each in known.items() if not names or name in names]
    try:
        with complaints(BackendError):
            size = QUICK if quick else FULL
            page, done = make(chosen, size, out, list(known), jobs or os.cpu_count() or 1, backend)
    except KeyboardInterrupt:
        fail("stopped; the same command goes on from the runs that are done", code=130)
    print(f"{done} runs made; written {page}")
