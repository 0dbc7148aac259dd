"""Kill, stop and mislead the nodes at random ticks of a walk: what must hold, holds?"""

import signal
from collections import Counter
from pathlib import Path
from typing import Annotated, Any

import typer
from rabbit_common.options import complaints, fail
from rabbit_common.own_folder import own_folder

FAILED, INTERRUPTED = 1, 130

app = typer.Typer(add_completion=False)


@app.command()
def faults(
    runs: Annotated[int, typer.Option(min=1, max=1_000_000, help="faults in all")] = 300,
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="of what comes when")] = 1,
    out: Annotated[Path, typer.Option(help="folder of the results; a campaign goes on there")] = Path("runs/faults"),
    hang_after: Annotated[float, typer.Option(min=1, max=3600, help="s after which a wait counts as a hang")] = 180.0,
) -> None:
    """Inject faults into a walk with all nodes and the recorder. Exit code 1 if one left something wrong."""
    from rabbit_common.executables import LaunchError
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

    from rabbit_campaigns.faults.plan import read_results
    from rabbit_campaigns.ros.fault_campaign import run_campaign

    own_folder(out, "faults")
    columns = (BarColumn(bar_width=20), MofNCompleteColumn(), TimeElapsedColumn(), TextColumn("{task.description}"))
    with Progress(*columns) as bar, complaints(LaunchError, OSError):
        task = bar.add_task("starting", total=runs, completed=len(read_results(out)))

        def show(row: dict[str, Any]) -> None:
            word = "" if row["passed"] else ", WRONG"
            bar.update(task, advance=1, description=f"{row['kind']}, {row['node']}{word}")

        for number in (signal.SIGINT, signal.SIGTERM):  # also where a shell has had Ctrl-C ignored
            signal.signal(number, signal.default_int_handler)
        try:
            rows = run_campaign(out, runs, seed, hang_after, show)
        except KeyboardInterrupt:
            bar.stop()
            fail(f"interrupted; the same command goes on from {out}", code=INTERRUPTED)
    tell(rows[:runs], out)
    if not all(row["passed"] for row in rows):
        raise typer.Exit(FAILED)


def tell(rows: list[dict[str, Any]], out: Path) -> None:
    """Counts on the screen."""
    from rich.console import Console
    from rich.table import Table

    kinds = list(dict.fromkeys(sorted(row["kind"] for row in rows)))
    table = Table("node", *kinds, title=f"{len(rows)} faults")
    counts = Counter((row["node"], row["kind"]) for row in rows)
    for node in sorted({row["node"] for row in rows}):
        table.add_row(node, *(str(counts[node, kind]) for kind in kinds))
    Console().print(table)
    slowest = max((row.get("seconds_to_recover", 0.0) for row in rows), default=0.0)
    print(f"hangs: {sum(row['hang'] for row in rows)}; lost transitions: {sum(row['lost'] for row in rows)}")
    unread = sum(not row.get("readable", True) or row.get("missing", 0) > 0 for row in rows)
    alone = sum("itself" in row["error"] for row in rows)
    read = [row for row in rows if "misread" in row]
    misread, strangers = sum(bool(row["misread"]) for row in read), sum(row["strangers"] for row in read)
    print(f"recordings not whole to within 1 s: {unread} of {len(read)}; nodes that ended by themselves: {alone}")
    print(
        f"recordings not rightly read: {misread} of {len(read) - strangers}; {strangers} more have strangers' messages"
    )
    print(f"slowest to go on: {slowest:.1f} s; written to {out}")
