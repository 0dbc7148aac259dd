"""The file of figures that a campaign leaves, with what made them; what it says on the screen."""

import json
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from rabbit_common.exit_codes import Interrupted
from rabbit_common.options import complaints, fail
from rabbit_experiments import provenance

ShowStatus = Callable[[str], object]  # in a line of the screen


def write_figures(path: Path, figures: Mapping[str, Any]) -> None:
    """Writes them as JSON, with command, commit and versions."""
    about = {"command": provenance.command(), "commit": provenance.commit(), "versions": provenance.versions()}
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({**figures, **about}, indent=2) + "\n", encoding="utf-8")


def print_table(head: Sequence[str], rows: Iterable[Sequence[str]], title: str = "") -> None:
    """Prints a table on the screen; a row is a text for each column."""
    from rich.console import Console
    from rich.table import Table

    table = Table(*head, title=title or None)
    for row in rows:
        table.add_row(*row)
    Console().print(table)


@contextmanager
def under_way(folder: Path, *errors: type[Exception]) -> Iterator[ShowStatus]:
    """Show a status line; yields the function that changes its text.

    A node's error, one of `errors` or a signal ends the command with one line.
    """
    from rabbit_common.executables import LaunchError
    from rich.console import Console

    with complaints(LaunchError, *errors), Console().status("starting") as status:
        try:
            yield status.update
        except Interrupted as error:
            fail(f"stopped by {error}; what was recorded is in {folder}", code=error.code)
