"""The file of figures that a campaign leaves, with what made them."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rabbit_experiments import provenance


def write_figures(path: Path, figures: Mapping[str, Any]) -> None:
    """As JSON, with command, commit and versions."""
    about = {"command": provenance.command(), "commit": provenance.commit(), "versions": provenance.versions()}
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({**figures, **about}, indent=2) + "\n", encoding="utf-8")
