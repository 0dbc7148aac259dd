"""The file of figures that a campaign leaves, with what made them; its tables on the screen."""

import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from rabbit_experiments import provenance


def write_figures(path: Path, figures: Mapping[str, Any]) -> None:
    """As JSON, with command, commit and versions."""
    about = {"command": provenance.command(), "commit": provenance.commit(), "versions": provenance.versions()}
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({**figures, **about}, indent=2) + "\n", encoding="utf-8")


def print_table(head: Sequence[str], rows: Iterable[Sequence[str]], title: str = "") -> None:
    """On the screen; a row is a text for each column."""
    from rich.console import Console
    from rich.table import Table

    table = Table(*head, title=title or None)
    for row in rows:
        table.add_row(*row)
    Console().print(table)
