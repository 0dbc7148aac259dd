"""Kill, stop and mislead the nodes at random ticks of a walk: what must hold, holds?"""

import signal
from collections import Counter
from pathlib import Path
from typing import Annotated, Any

import typer
from rabbit_common.options import complaints, fail, tell_if_bare
from rabbit_common.own_folder import own_folder

FAILED, INTERRUPTED = 1, 130

app = typer.Typer(add_completion=False)


@app.command()
def faults(
    context: typer.Context,
    runs: Annotated[int, typer.Option(min=1, max=1_000_000, help="number of faults")] = 300,
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="seed of faults and their ticks")] = 1,
    out: Annotated[Path, typer.Option(help="folder of the results; a campaign that was stopped there goes on")] = Path(
        "runs/faults"
    ),
) -> None:
    """Inject faults into a walk with all nodes and the recorder. Exit code 1 if one left something wrong."""
    tell_if_bare(
        context,
        f"{runs} faults, half a minute each; a campaign that is stopped goes on. To begin:",
        "rabbit faults --runs 300",
    )
    from rabbit_common.executables import LaunchError
    from rich.console import Console

    from rabbit_campaigns.ros.fault_campaign import run_campaign

    own_folder(out, "faults")
    for number in (signal.SIGINT, signal.SIGTERM):  # also where a shell has had Ctrl-C ignored
        signal.signal(number, signal.default_int_handler)
    with Console().status("starting") as status, complaints(LaunchError, OSError):

        def show(row: dict[str, Any]) -> None:
            word = "" if row["passed"] else ", WRONG"
            status.update(f"{row['number'] + 1} of {runs}: {row['kind']}, {row['node']}{word}")

        try:
            rows = run_campaign(out, runs, seed, show)
        except KeyboardInterrupt:
            fail(f"interrupted; the same command goes on from {out}", code=INTERRUPTED)
    tell(rows[:runs], out)
    if not all(row["passed"] for row in rows):
        raise typer.Exit(FAILED)


def tell(rows: list[dict[str, Any]], out: Path) -> None:
    """Counts on the screen."""
    from rabbit_campaigns.faults.plan import KINDS, NODES, SECOND
    from rabbit_campaigns.figures import print_table

    counts = Counter((row["node"], row["kind"]) for row in rows)
    cells = [(node, *(str(counts[node, kind]) for kind in KINDS)) for node in (*NODES, SECOND)]
    print_table(("node", *KINDS), cells, f"{len(rows)} faults")
    read = [row for row in rows if "misread" in row]
    found = {
        "hangs": sum(row["hang"] for row in rows),
        "lost transitions": sum(row["lost"] for row in rows),
        "nodes that ended by themselves": sum("itself" in row["error"] for row in rows),
        "recordings": len(read),
        "not whole to within 1 s": sum(not row["readable"] or row["missing"] > 0 for row in read),
        "not rightly read": sum(bool(row["misread"]) for row in read),
        "slowest to go on, s": max((row.get("seconds_to_recover", 0.0) for row in rows), default=0.0),
    }
    print("; ".join(f"{what}: {number:g}" for what, number in found.items()))
    print(f"written to {out}")
